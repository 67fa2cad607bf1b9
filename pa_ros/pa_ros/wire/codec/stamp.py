"""Times: builtin_interfaces/Time to and from nanoseconds of simulation time."""

from __future__ import annotations

from typing import Any

from pa_ros.wire import errors
from pa_ros.wire.interfaces import Clock

_NS = 1_000_000_000


def write_stamp(stamp: Any, stamp_ns: int) -> None:
    """Set a builtin_interfaces/Time in place."""
    stamp.sec, stamp.nanosec = divmod(stamp_ns, _NS)


def read_stamp(stamp: Any) -> int:
    """Nanoseconds of a builtin_interfaces/Time."""
    return int(stamp.sec) * _NS + int(stamp.nanosec)


def header_stamp(message: Any) -> int:
    """Stamp in nanoseconds of a message with a header: what the parts of one step share."""
    return read_stamp(message.header.stamp)


def encode_clock(stamp_ns: int, into: Clock | None = None) -> Clock:
    """Simulation time for /clock; perhaps in a message that has been sent."""
    message = into or Clock()
    write_stamp(message.clock, stamp_ns)
    return message


def decode_clock(message: Clock) -> int:
    """Simulation time in nanoseconds. Raises RangeError for one before zero."""
    stamp_ns = read_stamp(message.clock)
    if stamp_ns < 0 or message.clock.sec < 0:
        raise errors.RangeError("clock", "a time of at least zero, in ns", stamp_ns)
    return stamp_ns
