"""Messages and trajectories to measure with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pa_ros.core.experience import Observation, Step, Verdict
from pa_ros.language import Program
from pa_ros.wire.step import Command
from pa_ros.world import Trajectory
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

WORLD = World(PAPER, PAPER.vocabulary, joints=6)
JOINT_NAMES = tuple(f"joint_{i}" for i in range(1, WORLD.joints + 1))
OBJECTS = 5  # the hand and four blocks


def sample_step(seed: int = 0) -> tuple[Step, Command]:
    """A step, and the command that answers it."""
    rng = np.random.default_rng(seed)
    objects = rng.normal(size=(OBJECTS, WORLD.object_features)).astype(np.float32)
    joints = rng.normal(size=(2, WORLD.joints))
    pose = np.array([0.4, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    observation = Observation(3, 7, 10**9, objects, joints[0], joints[1], 0, "generated-3", pose)
    step = Step(observation, Verdict(-1.0, False, 0.4, False))
    action = rng.uniform(-1, 1, WORLD.actions).astype(np.float32)
    return step, Command(3, 7, 10**9, "agent", 1, action)


def whole_episode(
    world: World,
    number: int,
    program: Program,
    objects: ArrayLike,
    arm: ArrayLike,
    actions: ArrayLike,
    rewards: ArrayLike,
    version: int = 0,
) -> Trajectory:
    """A trajectory of T steps: `objects` [T + 1, N, F], `arm` [T + 1, A], `actions` [T, J],
    `rewards` [T]."""
    return Trajectory(
        "bench",
        number,
        version,
        number,
        0,
        program,
        0,
        np.asarray(objects, np.float32),
        np.asarray(arm, np.float32),
        np.asarray(actions, np.float32),
        np.asarray(rewards, np.float32),
        ends_episode=True,
        terminated=False,
        world_digest=world.digest,
    )
