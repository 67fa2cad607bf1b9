"""The examples of tests/extending: files of a newcomer's, loaded as the option --extension does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named, training_programs, world_of
from pa_ros.core import extensions
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import TrainConfig, train
from pa_ros.learning.protocols import protocol_named
from pa_ros.world import Reward

FOLDER = Path(__file__).parents[1] / "extending"
FRAMES = 300
SMALL = (  # of the protocol `ours`: what a few hundred frames need
    "learner.replay.warmup_frames=100",
    "learner.replay.batch_size=16",
    "network.hidden=16",
    "network.attention=8",
)


def example(name: str) -> ModuleType:
    """An example's file, loaded; a second time it is the same module."""
    return extensions.load([str(FOLDER / f"{name}.py")])[0]


def trained(
    out: Path,
    reward: Reward | None = None,
    algorithm: str = "dpg",
    frames: int = FRAMES,
    options: Sequence[str] = (),
) -> Learner:
    """Train FRAMES frames of 2-L on the fast arm under `ours`, in process."""
    design, arena = design_named("2-L"), preset_named("fast")
    protocol = protocol_named("ours", algorithm).with_options([*SMALL, *options])
    return train(
        TrainConfig(out=out, frames=frames, evaluate_every_frames=0),
        protocol.network_config(world_of(arena, design)),
        protocol.learner,
        ReachTask(arena, design, 0, reward=reward),
        np.array(arena.joint_speed_limits),
        training_programs(design),
    )
