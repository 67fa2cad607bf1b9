"""What passes between arena, actor and learner, whatever the transport."""

from __future__ import annotations

from dataclasses import dataclass
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
    hand_pose: Float64  # [7], x y z (m) and quaternion xyzw (qw >= 0) in the arm's base frame


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the verifier says of the state that an Observation of the same step describes."""

    episode: int
    step: int
    stamp_ns: int
    program_id: str
    reward: float  # pa_ros.world.Scoring's; in the paper +1 satisfied, -1 not
    satisfied: bool
    distance: float  # least measure of the relation among what the program names; inf if it is none
    truncated: bool  # the episode's time limit was reached (not a termination)


class AgentKey(NamedTuple):
    """One life of an agent. Who starts again under the same name is another."""

    agent_id: str
    incarnation: int  # grows with every start


class CommandKey(NamedTuple):
    """Names one command."""

    agent_id: str
    incarnation: int
    number: int  # 1, 2, 3, … per incarnation


@dataclass(frozen=True, slots=True, eq=False)
class Executed:
    """A command that was carried out exactly as given."""

    command: CommandKey
    action: Float32  # [J] share of each joint's speed limit, in [-1, 1]

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Executed)
            and self.command == other.command
            and np.array_equal(self.action, other.action)
        )


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
    tensors: dict[str, Float32]  # state-dict names; float32, C-contiguous
