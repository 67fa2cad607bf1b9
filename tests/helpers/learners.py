"""Learners and agents without a graph: made-up announcements, trajectories, small training runs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pa_ros.acting.agent import Agent, ArenaFacts
from pa_ros.acting.config import ExplorationConfig
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.arena import Design, ReachTask, design_named, preset_named, training_programs, world_of
from pa_ros.core import extensions
from pa_ros.core.experience import (
    AgentKey,
    Executed,
    LearnerInfo,
    Observation,
    PolicySnapshot,
    PublishedPolicy,
    Step,
    Verdict,
)
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.learning.recipes import LearningSettings
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor
from pa_ros.wire.arena import ArenaDescription, Mode
from pa_ros.world import Reward, Sparse, Trajectory

DESIGN, PRESET = design_named("2-L"), preset_named("fast")
WORDS, WORLD = DESIGN.vocabulary, world_of(PRESET, DESIGN)
FACTS = ArenaFacts(WORLD.digest, PRESET.control_period_s, (0.20,), Sparse().to_json())
NETWORK = NetworkConfig(world=WORLD, hidden=8, attention=4)
ME, YOU = AgentKey("me", 5), AgentKey("you", 5)

LEARNER = LearnerInfo(
    run_id="run",
    learner_id="learner",
    first_version=0,
    world_digest=FACTS.world_digest,
    architecture=NETWORK.architecture,
    trajectory_steps=10,
    policy_lag=1,
    exploration=ExplorationConfig().to_json(),
    inference="auto",
    control_period=FACTS.control_period,
    thresholds=FACTS.thresholds,
    reward=FACTS.reward,
    stamp_ns=1,
)


def again(learner: LearnerInfo, version: int, **changes: object) -> LearnerInfo:
    """The announcement of the restarted learner, of the same run unless `changes` replaces it."""
    later = {"learner_id": learner.learner_id + "'", "stamp_ns": learner.stamp_ns + 1}
    return replace(learner, **later, first_version=version, **changes)  # type: ignore[arg-type]


def snapshot(version: int, network: NetworkConfig = NETWORK) -> PolicySnapshot:
    """Weights that depend only on their version."""
    tensors = initial_actor(network, np.random.default_rng(version))
    return PolicySnapshot(version, network.architecture, network.world.digest, tensors)


def published(
    version: int, mine: int = 0, yours: int = 0, learner: LearnerInfo = LEARNER
) -> PublishedPolicy:
    """A policy version that acknowledges `mine` trajectories of ME and `yours` of YOU."""
    accounts = {ME: mine, YOU: yours}
    ids = learner.run_id, learner.learner_id
    return PublishedPolicy(snapshot(version), *ids, {k: n for k, n in accounts.items() if n})


ARENA = ArenaDescription(
    mode=Mode.LOCKSTEP, design="2-L", arm="jaco", preset="fast", seed=0, block_count=4,
    world=WORLD,
    training_programs=training_programs(DESIGN), joint_names=tuple("abcdef"),
    joint_lower=(-1.0,) * 6, joint_upper=(1.0,) * 6, speed_limits=(1.0,) * 6,
    control_period=0.1, thresholds=(0.2,), episode_steps=100,
)  # fmt: skip


def trajectory(sequence: int, agent: str = "a", length: int = 10) -> Trajectory:
    """A random trajectory that a learner accepts; the same `sequence` gives the same numbers."""
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


FAR_BEHIND = replace(LEARNER, policy_lag=10**6)  # an agent never waits for its weights
Says = Callable[[Executed], Executed | None]


def executed_as_sent(sent: Executed) -> Executed | None:
    return Executed(sent.command, sent.action.copy())


class Arm:
    """An arena and its agent in one process; the arm executes what the agent sends."""

    def __init__(self, agent: Agent) -> None:
        self.agent: Any = agent  # or a LearningAgent, depending on the test
        self.task = ReachTask(PRESET, DESIGN, seed=1)
        self.sent: list[Trajectory] = []
        self.velocity = np.zeros(6)

    def show(
        self,
        observation: Observation,
        verdict: Verdict,
        executed: Executed | None,
        evaluation: bool = False,
    ) -> None:
        step = Step(observation, verdict, evaluation=evaluation, executed=executed)
        trajectory = self.agent.observe(step, self.task.program)
        if trajectory is not None:
            self.sent.append(trajectory)
        self.velocity = np.zeros(6)
        if self.agent.prepare() is None:
            self.velocity = self.agent.act().astype(np.float64)

    def reset(self, episode: int, evaluation: bool = False) -> None:
        condition = "eval" if evaluation else "train"
        self.show(*self.task.reset(episode, condition), None, evaluation=evaluation)

    def run(self, steps: int, says: Says = executed_as_sent, evaluation: bool = False) -> None:
        """Act for `steps` steps. `says` turns what the agent sent into what the arena reports as
        executed."""
        for _ in range(steps):
            executed = says(self.agent.last_command)
            self.show(*self.task.step(self.velocity), executed, evaluation=evaluation)

    @property
    def spans(self) -> list[tuple[int, int, int]]:
        """(sequence, first step, length) of the trajectories sent."""
        return [(one.sequence, one.first_step, len(one)) for one in self.sent]


def following(learner: LearnerInfo = FAR_BEHIND) -> LearningAgent:
    """An agent that has joined a learner and received its first weights."""
    agent = LearningAgent(ME, seed=0)
    agent.follow(learner, FACTS)
    agent.offer(published(learner.first_version, learner=learner))
    return agent


EXAMPLES = Path(__file__).parents[1] / "extending"
FRAMES = 300


def small(warmup: int, batch: int, hidden: int, **attention: int) -> dict[str, Any]:
    """Settings of learners whose updates take little time."""
    replay = {"learner.replay.warmup_frames": warmup, "learner.replay.batch_size": batch}
    return {**replay, "network.hidden": hidden, **{f"network.{k}": v for k, v in attention.items()}}


SMALL = small(100, 16, 16, attention=8)  # a few hundred frames are enough for the recipe `ours`


def load_example(name: str) -> ModuleType:
    """Load a file of tests/extending as the option --extension does."""
    return extensions.load([str(EXAMPLES / f"{name}.py")])[0]


def trained(
    out: Path,
    reward: Reward | None = None,
    algorithm: str = "dpg",
    frames: int = FRAMES,
    design: Design = DESIGN,
    arm: str = "jaco",
    **settings: Any,
) -> Learner:
    """Train on a fast arm under `ours`, in process; `settings` are by dotted name."""
    arena = preset_named("fast", arm)
    learning = LearningSettings(algorithm=algorithm).changed(**SMALL | settings)
    return train(
        TrainConfig(
            out=out,
            frames=frames,
            evaluate_every_frames=0,
            environment={"design": "2-L", "preset": "fast", "arm": arm},
        ),
        learning.network.for_world(world_of(arena, design)),
        learning.learner,
        ReachTask(arena, design, 0, reward=reward),
        np.array(arena.joint_speed_limits),
        training_programs(design),
    )
