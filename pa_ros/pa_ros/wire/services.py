"""The arena's own services (Reset, SetSpeed), answers of all of them, and lifecycle transitions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from simulation_interfaces.msg import Result
from simulation_interfaces.srv import SetSimulationState
from std_srvs.srv import Trigger

from msgs_schema import srv
from pa_ros.wire import WireError
from pa_ros.wire.fields import SharedFields, read_stamp, write_stamp

GOING_ON = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)
SPEEDS = (0.01, 100.0)  # least and largest real-time factor


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """An episode to begin.

    `episode` None: the next one. `program` empty: from the arena's program source.
    """

    episode: int | None = None
    program: str = ""
    evaluation: bool = False


def is_any_active(message: GoalStatusArray) -> bool:
    """Whether an action server works on a goal of any client."""
    return any(goal.status in GOING_ON for goal in message.status_list)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The answer to a service call, and the arena's state after it."""

    success: bool
    code: str = ""
    reason: str = ""
    episode: int = 0
    stamp_ns: int = 0
    real_time_factor: float = 0.0


def encode_reset(request: ResetRequest) -> srv.Reset.Request:
    """The request for an episode."""
    episode = srv.Reset.Request.EPISODE_NEXT if request.episode is None else request.episode
    return srv.Reset.Request(
        episode=episode, program=request.program, evaluation=request.evaluation
    )


def decode_reset(message: srv.Reset.Request) -> ResetRequest:
    """The wanted episode."""
    named = message.episode != srv.Reset.Request.EPISODE_NEXT
    return ResetRequest(message.episode if named else None, message.program, message.evaluation)


def encode_speed(real_time_factor: float) -> srv.SetSpeed.Request:
    """The request for another real-time factor."""
    return srv.SetSpeed.Request(real_time_factor=float(real_time_factor))


def decode_speed(message: srv.SetSpeed.Request) -> float:
    """The wanted real-time factor. Raises WireError."""
    low, high = SPEEDS
    if not low <= message.real_time_factor <= high:
        field, received = "speed.real_time_factor", message.real_time_factor
        raise WireError(field, f"{low} to {high}", received, code="wire.range")
    return float(message.real_time_factor)


def encode_outcome(response: Any, outcome: Outcome) -> Any:
    """Fill the response of Reset or SetSpeed, and return it."""
    SharedFields(Outcome, response).write(response, outcome)
    if hasattr(response, "stamp"):
        write_stamp(response.stamp, outcome.stamp_ns)
    return response


def decode_outcome(response: Any) -> Outcome:
    """The answer to a call of any service of the arena.

    A request for the simulation state that is already current counts as a success.
    """
    if hasattr(response, "result"):
        code, reason = response.result.result, response.result.error_message
        current = isinstance(response, SetSimulationState.Response) and (
            code == response.ALREADY_IN_TARGET_STATE
        )
        return Outcome(code == Result.RESULT_OK or current, "", reason)
    stamp_ns = read_stamp(response.stamp) if hasattr(response, "stamp") else 0
    return Outcome(stamp_ns=stamp_ns, **SharedFields(Outcome, response).read(response))


def encode_trigger() -> Trigger.Request:
    """A request that says nothing but its name."""
    return Trigger.Request()


def encode_triggered(response: Any, success: bool, told: str) -> Any:
    """Fill the response to such a request, and return it."""
    response.success, response.message = success, told
    return response


def decode_triggered(response: Any) -> tuple[bool, str]:
    """Whether such a request succeeded, and what its receiver says."""
    return bool(response.success), str(response.message)


def decode_transition(message: Any) -> tuple[int, str]:
    """The wanted lifecycle transition: its id, and its label if one was given."""
    return int(message.transition.id), str(message.transition.label)
