"""How well cameras keep track of blocks while the script pushes them: at every step, each block is
compared with the track nearest to it.
"""

from __future__ import annotations

import argparse

import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named, scripted_action
from pa_ros.core.text import Report
from pa_ros.perception import SIDE_PX, VIEWS
from pa_ros.perception.calibration import Cameras
from pa_ros.perception.sight import Sight
from pa_ros.perception.task import calibrate

TRACKED_M = 0.03  # a block has a track if one is this close to it
MOVED_M = 0.02  # a block that is farther than this from where it began has moved


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--episodes", type=int, default=50, help="of each view (%(default)s)")
    parser.add_argument("--design", default="push-2", help="(%(default)s)")
    parser.add_argument("--views", nargs="+", default=[*VIEWS], choices=VIEWS)


def run(options: argparse.Namespace) -> Report:
    """Of each view, figures of `_episodes`."""
    return {
        f"tracking.{view}.{name}": value
        for view in options.views
        for name, value in _episodes(view, options.design, options.episodes).items()
    }


def _episodes(view: str, name: str, episodes: int) -> dict[str, float]:
    """Shares of (step, block) with a track, of all blocks and of those that have moved; how far
    those tracks are away (m); and per episode, tracks of no block, and tracks of several."""
    design = design_named(name)
    config = preset_named(design.preset)
    each = [calibrate(config, design, one, SIDE_PX) for one in VIEWS[view]]
    task, sight = ReachTask(config, design, 0), Sight(config, Cameras(tuple(each)))
    apart, moved = np.zeros(0), np.zeros(0, bool)
    false = swapped = 0
    for index in range(episodes):
        verdict = task.reset(index)[1]
        sight.begin()
        first = blocks = _blocks(task)
        owners: list[set[int]] = []
        while not verdict.truncated:
            state = task.simulation.model, task.simulation.data
            sight.look([one.take(*state) for one in sight.views], task.simulation.joint_position)
            blocks = _blocks(task)
            tracks = np.array([track.xy for track in sight.tracker.tracks]).reshape(-1, 1, 2)
            away = np.linalg.norm(tracks - blocks, axis=-1)  # [tracks, blocks]
            apart = np.append(apart, away.min(0, initial=np.inf))
            moved = np.append(moved, np.linalg.norm(blocks - first, axis=-1) > MOVED_M)
            owners += [set() for _ in range(len(tracks) - len(owners))]
            for track, block in zip(*np.nonzero(away < TRACKED_M), strict=True):
                owners[track].add(int(block))
            verdict = task.step(scripted_action(task))[1]
        false += len(owners) - len({min(owner) for owner in owners if owner})
        swapped += sum(len(owner) > 1 for owner in owners)
    sight.close()
    has = apart < TRACKED_M
    return {
        "tracked": float(has.mean()),
        "tracked_moved": float(has[moved].mean()),
        "median_m": float(np.median(apart[has])),
        "p95_m": float(np.percentile(apart[has], 95)),
        "moved_median_m": float(np.median(apart[has & moved])),
        "moved_p95_m": float(np.percentile(apart[has & moved], 95)),
        "false_tracks": false / episodes,
        "swapped_tracks": swapped / episodes,
    }


def _blocks(task: ReachTask) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Where the blocks are, [n, 2] m."""
    solid = [task.design.schema.has_body(block.kind) for block in task.episode.blocks]
    return np.array(task.simulation.positions[1:][solid, :2])
