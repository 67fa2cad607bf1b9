"""`pa_ros bag info|export|film BAG`: inspect a recording, or convert it."""

from __future__ import annotations

import argparse
from pathlib import Path

from pa_ros.bags.errors import BagError
from pa_ros.bags.experience import newest_arena
from pa_ros.bags.reader import Bag
from pa_ros.cli.film import add_look
from pa_ros.cli.options import add_extension, file_to_write
from pa_ros.core.errors import ConfigError
from pa_ros.core.text import printable_lines

EXIT_PARTIAL = 1  # parts of the bag could not be read


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros bag`."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    info = actions.add_parser("info", help="episodes, programs, scores, versions, gaps")
    export = actions.add_parser("export", help="episodes as NPZ, Parquet or for LeRobot")
    export.add_argument("--out", type=Path, metavar="DIR", help="for the files of --format")
    export.add_argument(
        "--lerobot", type=Path, metavar="DIR", help="a LeRobot v3 dataset in a new folder"
    )
    export.add_argument(
        "--video", type=int, metavar="PIXELS", help="with --lerobot: films from above, so wide"
    )
    export.add_argument(
        "--episodes", type=int, nargs="+", metavar="N", help="numbers (default: all)"
    )
    export.add_argument("--format", help="npz or parquet (npz)")
    film = actions.add_parser("film", help="draw a recorded episode as a film (WebP, GIF or MP4)")
    film.add_argument("--out", type=file_to_write, required=True, metavar="FILE.gif|FILE.mp4")
    film.add_argument("--episode", type=int, required=True, metavar="N")
    film.add_argument("--evaluation", action="store_true", help="the evaluation episode N")
    add_look(film)
    for action in (info, export, film):
        action.add_argument("bag", type=Path, metavar="BAG")
        action.add_argument("--namespace", help="namespace of the arena, if several were recorded")
        add_extension(action)


def run(options: argparse.Namespace) -> int:
    """Do one of the actions."""
    with Bag(options.bag) as bag:
        return {"info": _info, "export": _export, "film": _film}[options.action](bag, options)


def _info(bag: Bag, options: argparse.Namespace) -> int:
    from pa_ros.bags.summary import describe

    lines, complete = describe(bag, options.namespace)
    print(printable_lines("\n".join(lines)))
    return 0 if complete else EXIT_PARTIAL


def _export(bag: Bag, options: argparse.Namespace) -> int:
    from pa_ros.bags.episodes import episodes
    from pa_ros.bags.export import export

    if (options.out is None) == (options.lerobot is None):
        raise ConfigError("export: expected one of --out DIR and --lerobot DIR")
    if options.out is None and options.format is not None:
        raise ConfigError("export: expected --out with --format")
    if options.lerobot is None and options.video is not None:
        raise ConfigError("export: expected --lerobot with --video")
    if options.video is not None and (options.video % 2 or not 32 <= options.video <= 2000):
        raise ConfigError(
            f"export: --video: expected an even number from 32 to 2000, got {options.video}"
        )
    if options.lerobot is not None:
        return _export_lerobot(bag, options)
    count = export(
        episodes(bag, options.namespace), options.out, options.episodes, options.format or "npz"
    )
    print(f"{count} episodes in {options.out}, described in docs/tools.md")
    return 0


def _export_lerobot(bag: Bag, options: argparse.Namespace) -> int:
    from pa_ros.bags.episodes import episodes
    from pa_ros.bags.lerobot import export_lerobot

    arena = newest_arena(bag, options.namespace)
    found = episodes(bag, options.namespace)
    written = export_lerobot(found, arena, options.lerobot, options.episodes, options.video)
    print(f"{written.episodes} episodes, {written.frames} frames in {options.lerobot}")
    if written.cut:
        print(f"cut, because steps or actions are missing: {list(written.cut)}")
    return EXIT_PARTIAL if written.cut else 0


def _film(bag: Bag, options: argparse.Namespace) -> int:
    from pa_ros.bags.episodes import episodes
    from pa_ros.bags.film import film

    arena = newest_arena(bag, options.namespace)
    wanted = (options.episode, options.evaluation)
    for episode in episodes(bag, options.namespace):
        if (episode.number, episode.evaluation) == wanted:
            count = film(episode, arena, options.out, options.rendered, options.width)
            print(f"{count} pictures of episode {episode.number} in {options.out}")
            return 0
    kind = "evaluation episode" if options.evaluation else "episode"
    raise BagError(f"bag: {bag.path}: expected an {kind} that was recorded, got {options.episode}")
