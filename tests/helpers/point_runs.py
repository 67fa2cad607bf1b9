"""Training runs on the point world."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from helpers.worlds import PROGRAMS, WORLD, PointWorld, dpg
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import TrainConfig, train
from pa_ros.networks.config import NetworkConfig

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4)
SETTINGS = dpg(
    replay__batch_size=4,
    replay__capacity_frames=500,
    replay__warmup_frames=30,
    schedule__trajectory_steps=20,
    relabeling__rule="all-goals",
)
SPEED = np.ones(6)


def run(
    out: Path,
    frames: int,
    settings: DPGConfig = SETTINGS,
    resume: bool = False,
    network: NetworkConfig = NETWORK,
    **fields: object,
) -> Learner:
    config = TrainConfig(out=out, seed=3, frames=frames, **fields)  # type: ignore[arg-type]
    return train(config, network, settings, PointWorld(3), SPEED, PROGRAMS, None, resume)
