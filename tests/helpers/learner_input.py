"""What a learner node is told: a description of an arena, and trajectories from it."""

from __future__ import annotations

import numpy as np

from learner_node.config import LearnerNodeConfig
from learner_node.worker import LearnerWorker, Sinks
from pa_ros.arena import design_named, preset_named, training_programs, world_of
from pa_ros.wire.records import ArenaDescription, Mode
from pa_ros.world import Trajectory

DESIGN = design_named("2-L")
WORLD = world_of(preset_named("fast"), DESIGN)
ARENA = ArenaDescription(
    mode=Mode.LOCKSTEP, design="2-L", arm="jaco", preset="fast", seed=0, block_count=4,
    world=WORLD,
    training_programs=training_programs(DESIGN), joint_names=tuple("abcdef"),
    joint_lower=(-1.0,) * 6, joint_upper=(1.0,) * 6, speed_limits=(1.0,) * 6,
    control_period=0.1, thresholds=(0.2,), episode_steps=100,
)  # fmt: skip


def trajectory(sequence: int, agent: str = "a", length: int = 10) -> Trajectory:
    rng = np.random.default_rng(sequence)
    objects = rng.normal(size=(length + 1, 5, 16)).astype(np.float32)
    objects[:, :, 3:] = 0.0
    objects[:, :, 6] = 1.0  # qw
    for i, (shape, color) in enumerate(((0, 0), (0, 2), (1, 0), (1, 2)), start=1):
        objects[:, i, 7 + shape] = objects[:, i, 11 + color] = 1.0
    objects[:, 0, :3] = 0.0
    return Trajectory(
        agent_id=agent, sequence=sequence, policy_version=0, episode=sequence, first_step=0,
        program=training_programs(DESIGN)[0], hand_index=0, objects=objects,
        arm=rng.normal(size=(length + 1, 18)).astype(np.float32),
        actions=rng.uniform(-1, 1, (length, 6)).astype(np.float32),
        rewards=np.full(length, -1.0, np.float32), ends_episode=True, terminated=False,
        world_digest=WORLD.digest,
    )  # fmt: skip


def begin_run(config: LearnerNodeConfig) -> str:
    """Leave a checkpoint of version 0 in the folder `config.out`; the run's id."""
    worker = LearnerWorker(config, ARENA, Sinks(lambda _: None, lambda *_: None, lambda _: None))
    worker.start()
    worker.close()
    return worker.run.info.run_id
