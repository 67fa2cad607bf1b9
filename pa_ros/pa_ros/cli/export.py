"""`pa_ros export RUN`: an agent as an ONNX file or a model card, for use without pa_ros."""

from __future__ import annotations

import argparse
from pathlib import Path

from pa_ros.cli.laboratory import import_command
from pa_ros.cli.options import file_to_write
from pa_ros.core.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros export`."""
    parser.add_argument("run", help="folder that a training run left, or shipped:NAME")
    parser.add_argument("--onnx", type=file_to_write, metavar="FILE.onnx", help="extra onnx")
    parser.add_argument(
        "--program", action="append", default=[], metavar="TEXT",
        help="compiled into the ONNX file's metadata beside those of training; repeatable",
    )  # fmt: skip
    parser.add_argument("--card", type=file_to_write, metavar="FILE.md", help="a model card")
    parser.add_argument(
        "--scores", type=Path, metavar="FILE.json",
        help="scores for the card, by pa_ros eval --condition all --json FILE.json",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Write the files that were asked for."""
    if options.onnx is None and options.card is None:
        raise ConfigError("expected --onnx FILE.onnx or --card FILE.md")
    if options.onnx is None and options.program:
        raise ConfigError("--program: needs --onnx")
    if options.card is None and options.scores is not None:
        raise ConfigError("--scores: needs --card")
    if options.onnx is not None:
        _onnx(options)
    if options.card is not None:
        from pa_ros.core.files import write_whole

        cards = import_command("laboratory.studies.cards")
        scores = cards.read_report(options.scores) if options.scores is not None else None
        write_whole(options.card, cards.model_card(options.run, scores))
        print(f"{options.card}: a model card")
    return 0


def _onnx(options: argparse.Namespace) -> None:
    from pa_ros.agents import load_agent
    from pa_ros.language import parse
    from pa_ros.tools.export import OBSERVATIONS, export_onnx

    agent = load_agent(options.run)
    programs = [parse(text, agent.design.vocabulary) for text in options.program]
    worst = export_onnx(agent, options.onnx, programs)
    print(
        f"{options.onnx}: on {OBSERVATIONS:,} observations actions differ by {worst:.1g} at most; "
        "docs/tools.md describes inputs and outputs"
    )
