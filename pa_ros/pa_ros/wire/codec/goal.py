"""Goals of the action execute_program, how they stand, and what became of them."""

from __future__ import annotations

from math import isfinite

import numpy as np

from pa_ros.wire import errors
from pa_ros.wire.arrays import float32_field
from pa_ros.wire.codec.program import MAX_TEXT
from pa_ros.wire.interfaces import ExecuteProgram
from pa_ros.wire.records import GoalProgress, GoalResult, ProgramGoal

NEVER = -1.0
LONGEST_S = 1e9


def encode_goal(goal: ProgramGoal) -> ExecuteProgram.Goal:
    """Ask for a program to be executed."""
    return ExecuteProgram.Goal(
        program=goal.text, time_limit_s=goal.time_limit_s, hold_s=goal.hold_s
    )


def decode_goal(message: ExecuteProgram.Goal) -> ProgramGoal:
    """What is asked for; any text passes: the parser judges. Raises RangeError."""
    for field in ("time_limit_s", "hold_s"):
        value = getattr(message, field)
        if not (isfinite(value) and 0.0 <= value <= LONGEST_S):
            raise errors.RangeError(f"execute_program.{field}", f"0 to {LONGEST_S:g} s", value)
    return ProgramGoal(message.program[:MAX_TEXT], message.time_limit_s, message.hold_s)


def encode_goal_feedback(progress: GoalProgress) -> ExecuteProgram.Feedback:
    """Where a goal stands."""
    return ExecuteProgram.Feedback(
        distance=progress.distance,
        satisfied=progress.satisfied,
        objects=list(progress.objects),
        relevance=float32_field(np.array(progress.relevance, np.float32)),
        policy_version=progress.policy_version,
    )


def decode_goal_feedback(message: ExecuteProgram.Feedback) -> GoalProgress:
    """Raises SizeError for degrees that are neither none nor one for each object."""
    if len(message.relevance) not in (0, len(message.objects)):
        field = "execute_program.relevance"
        raise errors.SizeError(field, f"0 or {len(message.objects)}", len(message.relevance))
    return GoalProgress(
        message.distance,
        message.satisfied,
        tuple(message.objects),
        tuple(message.relevance),
        message.policy_version,
    )


def encode_goal_result(result: GoalResult) -> ExecuteProgram.Result:
    """What became of a goal."""
    return ExecuteProgram.Result(
        success=result.success,
        time_to_reach_s=NEVER if result.time_to_reach_s is None else result.time_to_reach_s,
        final_distance=result.final_distance,
        code=result.code,
        reason=result.reason,
        position=result.position,
    )


def decode_goal_result(message: ExecuteProgram.Result) -> GoalResult:
    """What became of a goal."""
    return GoalResult(
        message.success,
        message.final_distance,
        None if message.time_to_reach_s == NEVER else message.time_to_reach_s,
        message.code,
        message.reason,
        message.position,
    )
