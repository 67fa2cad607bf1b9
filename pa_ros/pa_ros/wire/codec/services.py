"""Requests to an arena and what became of them (Reset, Step, SetSpeed, std_srvs/SetBool); requests
to change a managed node's state (lifecycle_msgs/ChangeState)."""

from __future__ import annotations

from typing import Any

from pa_ros.wire import errors
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.interfaces import Reset, SetBool, SetSpeed, Step
from pa_ros.wire.records import Outcome, ResetRequest

MAX_STEPS = 1000
SPEEDS = (0.01, 100.0)


def encode_reset(request: ResetRequest) -> Reset.Request:
    """Ask for an episode. Raises RangeError for a number that no message holds."""
    episode, following = request.episode, Reset.Request.EPISODE_NEXT
    if episode is None:
        episode = following
    elif not 0 <= episode < following:
        raise errors.RangeError("reset.episode", f"0 to {following - 1}", episode)
    return Reset.Request(episode=episode, program=request.program, evaluation=request.evaluation)


def decode_reset(message: Reset.Request) -> ResetRequest:
    """What episode is asked for."""
    named = message.episode != Reset.Request.EPISODE_NEXT
    return ResetRequest(message.episode if named else None, message.program, message.evaluation)


def encode_steps(steps: int) -> Step.Request:
    """Ask a paused arena for `steps` control periods."""
    return Step.Request(steps=steps)


def decode_steps(message: Step.Request) -> int:
    """Raises RangeError."""
    if not 1 <= message.steps <= MAX_STEPS:
        raise errors.RangeError("step.steps", f"1 to {MAX_STEPS}", message.steps)
    return int(message.steps)


def encode_speed(real_time_factor: float) -> SetSpeed.Request:
    """Ask for another real-time factor."""
    return SetSpeed.Request(real_time_factor=float(real_time_factor))


def decode_speed(message: SetSpeed.Request) -> float:
    """Raises RangeError."""
    low, high = SPEEDS
    if not low <= message.real_time_factor <= high:
        field = "speed.real_time_factor"
        raise errors.RangeError(field, f"{low} to {high}", message.real_time_factor)
    return float(message.real_time_factor)


def encode_pause(paused: bool) -> SetBool.Request:
    """Ask for the arena to stop or to go on."""
    return SetBool.Request(data=paused)


def decode_pause(message: SetBool.Request) -> bool:
    """True: pause."""
    return bool(message.data)


def encode_outcome(response: Any, outcome: Outcome) -> Any:
    """Fill the response of any of these services; returns it."""
    response.success = outcome.success
    if isinstance(response, SetBool.Response):
        response.message = outcome.reason
        return response
    response.code, response.reason = outcome.code, outcome.reason
    if isinstance(response, SetSpeed.Response):
        response.real_time_factor = outcome.real_time_factor
        return response
    response.episode = outcome.episode
    write_stamp(response.stamp, outcome.stamp_ns)
    if isinstance(response, Step.Response):
        response.step = outcome.step
    return response


def decode_outcome(response: Any) -> Outcome:
    """What became of a call to any of these services."""
    if isinstance(response, SetBool.Response):
        return Outcome(response.success, reason=response.message)
    result = Outcome(response.success, response.code, response.reason)
    if isinstance(response, SetSpeed.Response):
        return Outcome(
            result.success, result.code, result.reason, real_time_factor=response.real_time_factor
        )
    return Outcome(
        result.success,
        result.code,
        result.reason,
        episode=response.episode,
        step=getattr(response, "step", 0),
        stamp_ns=read_stamp(response.stamp),
    )


def decode_transition(message: Any) -> tuple[int, str]:
    """The transition wanted: by its id, unless a label is given."""
    return int(message.transition.id), str(message.transition.label)
