"""Contents of message fields: arrays, times and vectors."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32, Float64
from pa_ros.wire import WireError

NS = 1_000_000_000
LARGEST_FLOAT32 = float(np.finfo(np.float32).max)
# Up to this many numbers, math.hypot over Python floats is faster than two NumPy calls.
FEW = 100
PLAIN = ("bool", "float", "int", "str")  # annotations of fields that messages have alike


def float32_field(values: Float32) -> array.array[float]:
    """Contents of a float32[] field. (Assigning an ndarray to the field is 25 times slower.)"""
    return array.array("f", np.asarray(values, np.float32).tobytes())


def float64_field(values: Float64) -> array.array[float]:
    """Contents of a float64[] field."""
    return array.array("d", np.asarray(values, np.float64).tobytes())


def read_array(
    name: str,
    values: Sequence[float],
    dtype: type[np.generic],
    shape: tuple[int, ...],
    largest: float = math.inf,
) -> NDArray[Any]:
    """A finite array of `shape` that owns its memory.

    Raises WireError: `wire.size` for another count, `wire.non_finite`, `wire.range` for a
    magnitude above `largest`.
    """
    expected = math.prod(shape)
    if len(values) != expected or expected == 0:
        shown = "×".join(map(str, shape))
        text = f"{shown} = {expected} numbers, at least one"
        raise WireError(name, text, len(values), code="wire.size")
    read = np.array(values, dtype)
    # No element is larger than the Euclidean length, so a short length proves all of them good.
    if expected <= FEW and math.hypot(*values) <= min(largest, LARGEST_FLOAT32):
        return read.reshape(shape)
    # The maximum is NaN or inf if any element is: one pass finds all three faults.
    reach = float(np.maximum.reduce(np.abs(read)))
    if not reach < math.inf:
        first = int(np.argmin(np.isfinite(read)))
        where = ",".join(str(int(i)) for i in np.unravel_index(first, shape))
        raise WireError(f"{name}[{where}]", "a finite number", read[first], code="wire.non_finite")
    if reach > largest:
        raise WireError(name, f"within ±{largest:g}", reach, code="wire.range")
    return read.reshape(shape)


def read_measures(name: str, values: Sequence[float], rows: int) -> Float64 | None:
    """The measures of P programs in each of so many rows, [rows, P]; None: not said.

    Raises WireError (`wire.range`) unless all are at least 0, or infinite.
    """
    if not len(values):
        return None
    measures = np.array(values, np.float64)
    if len(measures) % rows or not (measures >= 0).all():
        expected = f"numbers of at least 0, or inf, as many in each of {rows} rows"
        raise WireError(name, expected, f"{len(measures)} numbers", code="wire.range")
    return measures.reshape(rows, -1)


class SharedFields:
    """The fields that a record and a message both have, of some kinds in the record."""

    def __init__(self, record: type, message: Any, kinds: Sequence[str] = PLAIN) -> None:
        there = message.get_fields_and_field_types()
        self.names = [one.name for one in fields(record) if one.name in there and one.type in kinds]

    def write(self, message: Any, record: Any) -> None:
        """Set them in a message."""
        for name in self.names:
            setattr(message, name, getattr(record, name))

    def read(self, message: Any) -> dict[str, Any]:
        """Their values in a message, by name."""
        return {name: getattr(message, name) for name in self.names}


def write_stamp(stamp: Any, stamp_ns: int) -> None:
    """Set a builtin_interfaces/Time, or Duration, in place."""
    stamp.sec, stamp.nanosec = divmod(stamp_ns, NS)


def read_stamp(stamp: Any) -> int:
    """A builtin_interfaces/Time in nanoseconds."""
    return int(stamp.sec) * NS + int(stamp.nanosec)


def header_stamp(message: Any) -> int:
    """The header's stamp in nanoseconds: the parts of one control step share it."""
    return read_stamp(message.header.stamp)


def write_vector(target: Any, values: Float64, names: str = "xyz") -> None:
    """Set a vector, a point or (`names` "xyzw") a quaternion in place."""
    for name, value in zip(names, values.tolist(), strict=True):
        setattr(target, name, value)


def read_vector(source: Any, names: str = "xyz") -> Float64:
    """A vector, a point or (`names` "xyzw") a quaternion."""
    return np.array([getattr(source, name) for name in names])
