"""The arena's own services (Reset, Step, SetSpeed, std_srvs/SetBool), and lifecycle transitions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from std_srvs.srv import SetBool

from msgs_schema import srv
from pa_ros.wire.arena import NO_STAMP
from pa_ros.wire.errors import WireError
from pa_ros.wire.fields import read_stamp, write_stamp

MAX_STEPS = 1000
SPEEDS = (0.01, 100.0)


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """An episode to begin: `episode` None is the next one.

    An empty `program` means: as the arena's program source says.
    """

    episode: int | None = None
    program: str = ""
    evaluation: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """The answer to a service call, and the arena's state after it."""

    success: bool
    code: str = ""
    reason: str = ""
    episode: int = 0
    step: int = 0
    stamp_ns: int = NO_STAMP
    real_time_factor: float = 0.0


def encode_reset(request: ResetRequest) -> srv.Reset.Request:
    """Ask for an episode. Raises RangeError for a number that no message holds."""
    episode, following = request.episode, srv.Reset.Request.EPISODE_NEXT
    if episode is None:
        episode = following
    elif not 0 <= episode < following:
        raise WireError("reset.episode", f"0 to {following - 1}", episode, code="wire.range")
    return srv.Reset.Request(
        episode=episode, program=request.program, evaluation=request.evaluation
    )


def decode_reset(message: srv.Reset.Request) -> ResetRequest:
    """What episode is asked for."""
    named = message.episode != srv.Reset.Request.EPISODE_NEXT
    return ResetRequest(message.episode if named else None, message.program, message.evaluation)


def encode_steps(steps: int) -> srv.Step.Request:
    """Ask a paused arena for `steps` control periods."""
    return srv.Step.Request(steps=steps)


def decode_steps(message: srv.Step.Request) -> int:
    """Raises RangeError."""
    if not 1 <= message.steps <= MAX_STEPS:
        raise WireError("step.steps", f"1 to {MAX_STEPS}", message.steps, code="wire.range")
    return int(message.steps)


def encode_speed(real_time_factor: float) -> srv.SetSpeed.Request:
    """Ask for another real-time factor."""
    return srv.SetSpeed.Request(real_time_factor=float(real_time_factor))


def decode_speed(message: srv.SetSpeed.Request) -> float:
    """Raises RangeError."""
    low, high = SPEEDS
    if not low <= message.real_time_factor <= high:
        field = "speed.real_time_factor"
        raise WireError(field, f"{low} to {high}", message.real_time_factor, code="wire.range")
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
    if isinstance(response, srv.SetSpeed.Response):
        response.real_time_factor = outcome.real_time_factor
        return response
    response.episode = outcome.episode
    write_stamp(response.stamp, outcome.stamp_ns)
    if isinstance(response, srv.Step.Response):
        response.step = outcome.step
    return response


def decode_outcome(response: Any) -> Outcome:
    """What became of a call to any of these services."""
    if isinstance(response, SetBool.Response):
        return Outcome(response.success, reason=response.message)
    result = Outcome(response.success, response.code, response.reason)
    if isinstance(response, srv.SetSpeed.Response):
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
