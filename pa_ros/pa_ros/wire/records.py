"""What the wire carries beside `pa_ros.core.experience`: each mirrors a message of msgs_schema."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from math import inf
from typing import Any

from pa_ros.core.experience import CommandKey, Executed, Float32
from pa_ros.language import Program
from pa_ros.world import Sparse
from pa_ros.world.world import World

WIRE_VERSION = "3"  # edition of msgs_schema; changes when a receiver could misread the other
NO_STAMP = 0
SPARSE = Sparse().to_json()  # the paper's reward


class Mode(IntEnum):
    """What paces the arena; values of ArenaInfo."""

    LOCKSTEP = 1
    REAL_TIME = 2


@dataclass(frozen=True, slots=True)
class Command:
    """An agent's answer to one observation."""

    episode: int
    step: int
    stamp_ns: int  # of the observation answered
    agent_id: str
    policy_version: int
    action: Float32  # [J], share of each joint's speed limit
    incarnation: int = 0  # of the agent
    number: int = 0  # of the command, among the agent's

    @property
    def key(self) -> CommandKey:
        """Its name."""
        return CommandKey(self.agent_id, self.incarnation, self.number)


@dataclass(frozen=True, slots=True)
class StepContext:
    """What an observation's messages say beside the observation itself."""

    arena_id: str = ""
    evaluation: bool = False  # must leave no trace in training
    executed: Executed | None = None  # the command that, exactly, led here; None: no one's
    program: str = ""  # in force, canonical; empty: none


@dataclass(frozen=True, slots=True)
class StepMark:
    """Which control step something is of."""

    episode: int
    step: int
    evaluation: bool  # episodes of either kind are numbered apart
    program_id: str  # in force; empty: none
    program: str = ""  # its text, where the message has it


@dataclass(frozen=True, slots=True)
class ArenaDescription:
    """What an arena offers; see ArenaInfo.msg for units."""

    mode: Mode
    design: str
    arm: str
    preset: str
    seed: int
    block_count: int
    world: World
    training_programs: tuple[Program, ...]
    joint_names: tuple[str, ...]
    joint_lower: tuple[float, ...]  # rad
    joint_upper: tuple[float, ...]  # rad
    speed_limits: tuple[float, ...]  # rad/s
    control_period: float  # s
    thresholds: tuple[float, ...]  # of the world's relations, in their units
    episode_steps: int
    reward: str = SPARSE  # canonical JSON: name and parameters
    hand_index: int = 0
    stamp_ns: int = NO_STAMP
    arena_id: str = ""
    software_version: str = ""


@dataclass(frozen=True, slots=True)
class ProgramRequest:
    """A program that someone asks for; `program_id` is never empty after decoding."""

    program_id: str
    text: str


@dataclass(frozen=True, slots=True)
class ProgramJudgement:
    """One node's answer to a ProgramRequest."""

    program_id: str
    node: str
    accepted: bool
    canonical: str = ""
    code: str = ""
    reason: str = ""
    position: int = -1
    stamp_ns: int = NO_STAMP


@dataclass(frozen=True, slots=True)
class ProgramGoal:
    """A program to be executed until it has been satisfied for `hold_s`; simulation time."""

    text: str
    time_limit_s: float = 0.0  # 0: none
    hold_s: float = 0.0


@dataclass(frozen=True, slots=True)
class GoalProgress:
    """Where the execution of a goal stands."""

    distance: float  # m; inf: nothing named, or no step seen yet
    satisfied: bool
    objects: tuple[str, ...]  # [N] labels
    relevance: tuple[float, ...]  # [N] p, or empty
    policy_version: int


@dataclass(frozen=True, slots=True)
class GoalResult:
    """What became of a goal."""

    success: bool
    final_distance: float = inf  # m
    time_to_reach_s: float | None = None  # simulation time; None: never
    code: str = ""
    reason: str = ""
    position: int = -1  # where in the program's text; -1: nowhere


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """`episode` None: the next one; `program` empty: as the arena's program source says."""

    episode: int | None = None
    program: str = ""
    evaluation: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a service call, and where the arena stands after it."""

    success: bool
    code: str = ""
    reason: str = ""
    episode: int = 0
    step: int = 0
    stamp_ns: int = NO_STAMP
    real_time_factor: float = 0.0


@dataclass(frozen=True, slots=True)
class Health:
    """One entry of /diagnostics. Levels are those of DiagnosticStatus: 0 ok, 1 warn, 2 error."""

    name: str
    level: int = 0
    message: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LearnerOrigin:
    """What else makes a learner's weights what they are."""

    first_version: int  # of the weights it began with; 0: from scratch
    network: str  # NetworkConfig's JSON
    learner: str  # the learner settings' JSON
    algorithm: str  # whose settings these are
    training_programs: tuple[Program, ...]  # in relabeling's order


@dataclass(frozen=True)
class Origin:
    """One process's account of itself; see Provenance.msg."""

    node: str
    instance: str
    software_version: str
    versions: str
    seed: int
    parameters: Mapping[str, Any]  # plain JSON
    design: str = ""
    arm: str = ""
    preset: str = ""
    world: World | None = None  # None: not known to the sender
    stamp_ns: int = NO_STAMP  # wall time
    learner: LearnerOrigin | None = None  # None: not a learner


def program_id_of(text: str) -> str:
    """The id of a program sent without one: a function of its text alone."""
    return "text-" + hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:12]
