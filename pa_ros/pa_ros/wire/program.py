"""Programs, the answers to them, and goals of the action execute_program."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np

from msgs_schema import action, msg
from pa_ros.wire import WireError
from pa_ros.wire.fields import SharedFields, float32_field, read_stamp, write_stamp

NEVER = -1.0  # time_to_reach_s of a goal that was not reached
LONGEST_S = 1e9


@dataclass(frozen=True, slots=True)
class ProgramRequest:
    """A program to execute; `program_id` is never empty after decoding."""

    program_id: str
    text: str


@dataclass(frozen=True, slots=True)
class ProgramStatus:
    """One node's answer to a ProgramRequest."""

    program_id: str
    node: str
    accepted: bool
    canonical: str = ""
    code: str = ""
    reason: str = ""
    position: int = -1
    stamp_ns: int = 0


@dataclass(frozen=True, slots=True)
class ProgramGoal:
    """A program to execute until it has been satisfied for `hold_s`. Times are simulation time."""

    text: str
    time_limit_s: float = 0.0  # 0: no limit
    hold_s: float = 0.0


@dataclass(frozen=True, slots=True)
class GoalProgress:
    """The current state of a goal's execution."""

    distance: float  # m; inf: the program names no object here, or no step was received yet
    satisfied: bool
    objects: tuple[str, ...]  # [N] labels
    relevance: tuple[float, ...]  # [N] p, or empty
    policy_version: int
    stage: int = 0  # the program that is pursued, in the order of the text
    stages: int = 1


@dataclass(frozen=True, slots=True)
class GoalResult:
    """How a goal ended."""

    success: bool
    final_distance: float = inf  # m
    time_to_reach_s: float | None = None  # simulation time; None: never
    code: str = ""
    reason: str = ""
    position: int = -1  # character in the program's text; -1: not at one place


SAME_OF_STATUS = SharedFields(ProgramStatus, msg.ProgramStatus)
SAME_OF_FEEDBACK = SharedFields(GoalProgress, action.ExecuteProgram.Feedback)
SAME_OF_RESULT = SharedFields(GoalResult, action.ExecuteProgram.Result)


def program_id_of(text: str) -> str:
    """The id of a program sent without one: a function of its text alone."""
    return "text-" + hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:12]


def encode_program(request: ProgramRequest) -> msg.Program:
    """A program to execute."""
    return msg.Program(program_id=request.program_id, text=request.text)


def decode_program(message: msg.Program) -> ProgramRequest:
    """A request whose text is not checked yet: the parser does that."""
    return ProgramRequest(message.program_id or program_id_of(message.text), message.text)


def encode_program_status(status: ProgramStatus) -> msg.ProgramStatus:
    """One node's answer to a program."""
    message = msg.ProgramStatus()
    SAME_OF_STATUS.write(message, status)
    message.status = message.ACCEPTED if status.accepted else message.REFUSED
    write_stamp(message.stamp, status.stamp_ns)
    return message


def decode_program_status(message: msg.ProgramStatus) -> ProgramStatus:
    """A node's answer. Raises WireError (`wire.range`) for a status that is neither."""
    if message.status not in (msg.ProgramStatus.ACCEPTED, msg.ProgramStatus.REFUSED):
        expected = "ACCEPTED or REFUSED"
        raise WireError("program_status.status", expected, message.status, code="wire.range")
    return ProgramStatus(
        accepted=message.status == msg.ProgramStatus.ACCEPTED,
        stamp_ns=read_stamp(message.stamp),
        **SAME_OF_STATUS.read(message),
    )


def encode_goal(goal: ProgramGoal) -> action.ExecuteProgram.Goal:
    """The request for a program to be executed."""
    return action.ExecuteProgram.Goal(
        # rclpy would read the bits of an int as those of a float.
        program=goal.text,
        time_limit_s=float(goal.time_limit_s),
        hold_s=float(goal.hold_s),
    )


def decode_goal(message: action.ExecuteProgram.Goal) -> ProgramGoal:
    """The goal; the parser checks its text later. Raises WireError (`wire.range`)."""
    for field in ("time_limit_s", "hold_s"):
        value = getattr(message, field)
        if not (isfinite(value) and 0.0 <= value <= LONGEST_S):
            expected = f"0 to {LONGEST_S:g} s"
            raise WireError(f"execute_program.{field}", expected, value, code="wire.range")
    return ProgramGoal(message.program, message.time_limit_s, message.hold_s)


def encode_goal_feedback(progress: GoalProgress) -> action.ExecuteProgram.Feedback:
    """The current state of a goal's execution."""
    message = action.ExecuteProgram.Feedback(
        objects=list(progress.objects),
        relevance=float32_field(np.array(progress.relevance, np.float32)),
    )
    SAME_OF_FEEDBACK.write(message, progress)
    return message


def decode_goal_feedback(message: Any) -> GoalProgress:
    """The current state of a goal's execution.

    :param message: what an action client receives (`ExecuteProgram.Impl.FeedbackMessage`).
    """
    feedback = message.feedback
    return GoalProgress(
        objects=tuple(feedback.objects),
        relevance=tuple(feedback.relevance),
        **SAME_OF_FEEDBACK.read(feedback),
    )


def encode_goal_result(result: GoalResult) -> action.ExecuteProgram.Result:
    """How a goal ended."""
    message = action.ExecuteProgram.Result()
    SAME_OF_RESULT.write(message, result)
    message.time_to_reach_s = NEVER if result.time_to_reach_s is None else result.time_to_reach_s
    return message


def decode_goal_result(message: action.ExecuteProgram.Result) -> GoalResult:
    """How a goal ended."""
    reached_s = None if message.time_to_reach_s == NEVER else message.time_to_reach_s
    return GoalResult(time_to_reach_s=reached_s, **SAME_OF_RESULT.read(message))
