"""Data that arena, actor and learner exchange, over any transport."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Observation:
    """One control step as an agent sees it. Arrays are owned by this object."""

    episode: int
    step: int  # 0 is the observation a reset returns
    stamp_ns: int  # simulation time; never goes back, not even at a reset
    objects: Float32  # [N, F], `world.schema.ObjectSchema`; the hand is one of the N
    joint_position: Float64  # [J] rad
    joint_velocity: Float64  # [J] rad/s
    hand_index: int
    program_id: str  # the program the verifier scores this step under
    hand_pose: Float64
    """[7], x y z (m) and quaternion xyzw (qw >= 0) in the arm's base frame; of an arm with a
    gripper [8], then 1 where it holds something, else 0."""

    @property
    def hold(self) -> Float64:
        """The command that keeps the arm where it is, and what it holds: no velocity [J], then the
        gripper's number if there is one."""
        return np.concatenate([np.zeros(len(self.joint_position)), self.hand_pose[7:]])


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verifier's answer for the state in an observation, under the goal in force."""

    reward: float  # pa_ros.world.Scoring's; in the paper +1 satisfied, -1 not
    satisfied: bool
    distance: float  # least measure of the relation among what the program names; inf if it is none
    truncated: bool  # the episode's time limit was reached (not a termination)
    stage: int = 0  # the program of the goal that is pursued, in the order of the text
    violated: bool = False  # an object to be avoided was near, so the goal cannot hold any more
    measures: tuple[float, ...] | None = None
    """The distance under each training program, inf if it names nothing here; None: not said."""


@dataclass(frozen=True)
class Body:
    """Position and motion of a body in the frame of the arm's base, on the table."""

    position: Float64  # [3] m
    quaternion: Float64  # [4] xyzw
    linear: Float64  # [3] m/s
    angular: Float64  # [3] rad/s, about that frame's axes

    @classmethod
    def at_rest(cls, position: Float64, quaternion: Float64) -> Body:
        """A body that does not move."""
        return cls(position, quaternion, np.zeros(3), np.zeros(3))


class AgentKey(NamedTuple):
    """One run of an agent; a restarted agent of the same name is a new incarnation."""

    agent_id: str
    incarnation: int  # grows with every start


PERSON = "a person"  # as agent_id: a person moved the arm in the place of the agent it obeys


class CommandKey(NamedTuple):
    """Names one command."""

    agent_id: str
    incarnation: int
    number: int  # 1, 2, 3, … per incarnation


@dataclass(frozen=True, slots=True, eq=False)
class Executed:
    """A command, and the action that it led to: a robot's guard may have changed it."""

    command: CommandKey
    action: Float32
    """[J] share of each joint's speed limit, in [-1, 1]; of a gripper one more, on above 0."""

    def answers(self, sent: Executed | None) -> bool:
        """Whether it is what became of a command, or what a person did at that step instead."""
        if sent is None or self.command == sent.command:
            return sent is not None
        return self.command == sent.command._replace(agent_id=PERSON)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Executed)
            and self.command == other.command
            and self.action.tobytes() == other.action.tobytes()
        )


@dataclass(frozen=True, slots=True)
class Step:
    """One control step, as the arena that made it tells everyone."""

    observation: Observation
    verdict: Verdict | None = None  # None: nobody judged it, so nothing can be learned from it
    program: str = ""  # canonical text of the program in force; empty: none
    evaluation: bool = False  # act greedily, and leave no trace in training
    executed: Executed | None = None  # the action that led here, and the one command it answers
    arena_id: str = ""

    @property
    def stage(self) -> int:
        """Which program of a goal over time is pursued; 0 where nobody judged the step."""
        return self.verdict.stage if self.verdict is not None else 0


class TrajectoryKey(NamedTuple):
    """Names one trajectory."""

    agent_id: str
    incarnation: int
    sequence: int


@dataclass(frozen=True)
class PolicySnapshot:
    """Weights of an actor at one version: the only thing that flows from learner to agents."""

    version: int
    architecture: str  # canonical JSON of the network's configuration
    world_digest: str
    tensors: dict[str, Float32] = field(repr=False)  # state-dict names; float32, C-contiguous


ENDLESS = 2**31 - 1  # steps of an episode without a time limit: 6.8 years at 10 Hz
NO_LAG = 2**32 - 1  # as policy_lag: agents act with the newest weights they have, and never wait


@dataclass(frozen=True, slots=True)
class LearnerInfo:
    """A learner's requirements of its agents, and all that they need to know about it."""

    run_id: str  # kept when a run resumes
    learner_id: str  # new at every start
    first_version: int  # newest version of the weights at this start; 0: from scratch
    world_digest: str
    architecture: str  # canonical JSON of the actor's configuration
    trajectory_steps: int  # transitions after which a trajectory is sent at the latest
    policy_lag: int  # trajectories; NO_LAG: agents do not wait
    exploration: str  # canonical JSON of the exploration noise
    inference: str  # what computes actions: "auto" or "torch"
    control_period: float  # s, of the arena learned about
    thresholds: tuple[float, ...]  # of the relations of the arena learned about
    reward: str  # canonical JSON: name and parameters, of the arena learned about
    algorithm: str = "dpg"  # for people: agents act by the rest
    software_version: str = ""
    stamp_ns: int = 0  # wall time; of one run, agents follow the learner that started last

    @property
    def free(self) -> bool:
        """Whether agents act with the newest weights they have, and never wait."""
        return self.policy_lag == NO_LAG


@dataclass(frozen=True)
class PublishedPolicy:
    """A snapshot with what the synchronous protocol needs to know of it."""

    snapshot: PolicySnapshot
    run_id: str
    learner_id: str = ""
    # For each agent, the sequence number before which every trajectory is accounted for.
    accounted: Mapping[AgentKey, int] = field(default_factory=dict)
    latest: TrajectoryKey | None = None  # the trajectory that led to this version, if known
    stamp_ns: int = 0  # wall time

    @property
    def name(self) -> tuple[str, str, int]:
        """Run, learner and version: equal for the same weights."""
        return self.run_id, self.learner_id, self.snapshot.version
