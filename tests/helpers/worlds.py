"""A point world, small enough to solve in seconds, with random experience and training runs."""

from pathlib import Path

import numpy as np

from pa_ros.core.experience import Float64, Observation, Verdict
from pa_ros.core.update import Batch
from pa_ros.language import Vocabulary, parse
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Reward, Scoring, Sparse, Trajectory
from pa_ros.world.schema import COLORS, PAPER, SHAPES, ObjectSchema, PropertyGroup, Seen
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
WORLD = World(PAPER, WORDS, joints=6)
UNTOLD = ObjectSchema(  # as PAPER, but its features tell no words
    (PropertyGroup("shape", SHAPES, Seen(4)), PropertyGroup("color", COLORS, Seen(5)))
)
POSE = np.array([0.4, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])  # pose of a hand
PROGRAMS = tuple(
    parse(f"NEAR(HAND, AND({words}))", WORDS) for words in ("RED, CUBE", "BLUE, SPHERE")
)
KINDS = ((7, 11), (8, 13))  # one-hots of a red cube and a blue sphere
NEAR_M = 0.25


def dpg(base: DPGConfig | None = None, /, **values: object) -> DPGConfig:
    """Settings with some values changed: `replay__batch_size=4` is replay.batch_size."""
    changed = {name.replace("__", "."): value for name, value in values.items()}
    return (base or DPGConfig()).changed(**changed)


SCORING = Scoring({"NEAR": NEAR_M})  # of a PointWorld with the default reward


def objects_at(positions: Float64) -> np.ndarray:
    """Ω of a hand at the origin, a red cube and a blue sphere, [3, 16]."""
    objects = np.zeros((3, 16), np.float32)
    objects[:, 6] = 1.0
    for row, (position, one_hots) in enumerate(zip(positions, KINDS, strict=True), start=1):
        objects[row, :3] = position
        objects[row, list(one_hots)] = 1.0
    return objects


def random_batch(rng: np.random.Generator, size: int, k: int, programs: int) -> Batch:
    """`size` transitions, each with `k` of `programs` programs."""

    def scenes() -> np.ndarray:
        return np.stack([objects_at(rng.normal(0, 0.3, (2, 3))) for _ in range(size)])

    return Batch(
        objects=scenes(),
        arm=rng.normal(size=(size, 18)).astype(np.float32),
        action=rng.uniform(-1, 1, (size, 6)).astype(np.float32),
        next_objects=scenes(),
        next_arm=rng.normal(size=(size, 18)).astype(np.float32),
        program=rng.integers(programs, size=(size, k)).astype(np.int32),
        reward=rng.choice([-1.0, 1.0], (size, k)).astype(np.float32),
        discount=rng.choice([0.0, 0.99], size).astype(np.float32),
    )


class PointWorld:
    """A hand that moves in the plane by the first two velocities; two blocks that stay.

    The reward is +1 within NEAR_M of the named block, or what `reward` pays. It has the same
    methods as the arena's task.
    """

    def __init__(self, seed: int = 0, steps: int = 20, reward: Reward | None = None) -> None:
        self._seed, self._steps = seed, steps
        self.scoring = Scoring({"NEAR": NEAR_M}, reward or Sparse())
        self.control_period_s = 0.1
        self._stamp = 0
        self.program = PROGRAMS[0]

    def reset(self, episode_index: int, condition: str = "train") -> tuple[Observation, Verdict]:
        rng = np.random.default_rng([self._seed, 0, episode_index])
        self.episode, self._step = episode_index, 0
        self.program = PROGRAMS[rng.integers(2)]
        angle = rng.uniform(0, 2 * np.pi)
        place = 0.6 * np.array([np.cos(angle), np.sin(angle), 0.0])
        self._blocks = np.stack([place, -place])
        self._hand = np.zeros(3)
        return self._observe()

    def step(self, joint_velocity: Float64) -> tuple[Observation, Verdict]:
        self._step += 1
        self._hand[:2] += 0.1 * np.clip(joint_velocity[:2], -1, 1)
        return self._observe()

    def _observe(self) -> tuple[Observation, Verdict]:
        self._stamp += 100
        positions = self._blocks - self._hand
        objects = objects_at(positions)
        named = np.arange(3) == 1 + PROGRAMS.index(self.program)
        distance, near, reward = (value.item() for value in self.scoring(named, objects))
        where = (self.episode, self._step, self._stamp)
        joints = np.concatenate([self._hand, np.zeros(3)])
        program_id = f"{self.episode}.0"
        observation = Observation(*where, objects, joints, 0 * joints, 0, program_id, POSE)
        truncated = self._step >= self._steps
        verdict = Verdict(reward, bool(near), distance, truncated)
        return observation, verdict


def random_trajectory(rng: np.random.Generator, steps: int = 5, **fields: object) -> Trajectory:
    """Random numbers of the right shapes; `fields` replace any of them."""
    values = {
        "agent_id": "agent",
        "sequence": 0,
        "policy_version": 0,
        "episode": 0,
        "first_step": 0,
        "program": PROGRAMS[0],
        "hand_index": 0,
        "objects": np.stack([objects_at(rng.normal(0, 0.3, (2, 3))) for _ in range(steps + 1)]),
        "arm": rng.normal(size=(steps + 1, 18)).astype(np.float32),
        "actions": rng.uniform(-1, 1, (steps, 6)).astype(np.float32),
        "rewards": rng.choice([-1.0, 1.0], steps).astype(np.float32),
        "ends_episode": True,
        "terminated": False,
        "world_digest": WORLD.digest,
    }
    return Trajectory(**(values | fields))  # type: ignore[arg-type]


NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4)
SETTINGS = dpg(
    replay__batch_size=4,
    replay__capacity_frames=500,
    replay__warmup_frames=30,
    schedule__trajectory_steps=20,
    relabeling__rule="all-goals",
)
SPEED = np.ones(6)
ENVIRONMENT = {"design": "2-L", "preset": "fast", "arm": "jaco"}


def run(
    out: Path,
    frames: int,
    settings: DPGConfig = SETTINGS,
    resume: bool = False,
    network: NetworkConfig = NETWORK,
    **fields: object,
) -> Learner:
    """Train on the point world."""
    given = {"out": out, "seed": 3, "frames": frames, "environment": ENVIRONMENT, **fields}
    config = TrainConfig(**given)  # type: ignore[arg-type]
    return train(config, network, settings, PointWorld(3), SPEED, PROGRAMS, None, resume)
