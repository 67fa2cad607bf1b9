"""Arrays to and from the `array.array` fields of messages, checked, in one copy each."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32, Float64
from pa_ros.wire.errors import NonFiniteError, RangeError, SizeError

FEW = 12  # numbers of which a sum in Python's own floats is the fastest look at all
LARGEST_FLOAT32 = float(np.finfo(np.float32).max)


def float32_field(values: Float32) -> array.array[float]:
    """Contents for a float32[] field. Filling it with an ndarray costs 25 times as much."""
    return array.array("f", np.ascontiguousarray(values, dtype=np.float32).tobytes())


def float64_field(values: Float64) -> array.array[float]:
    """Contents for a float64[] field."""
    return array.array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())


def read_float32(
    name: str, values: Sequence[float], shape: tuple[int, ...], largest: float = math.inf
) -> Float32:
    """A finite float32 array of `shape` that owns its memory, no number larger than `largest`
    either way. Raises SizeError, NonFiniteError, RangeError."""
    return _checked(name, values, shape, np.float32, largest)


def read_float64(
    name: str, values: Sequence[float], shape: tuple[int, ...], largest: float = math.inf
) -> Float64:
    """The same in float64."""
    return _checked(name, values, shape, np.float64, largest)


def _checked(
    name: str,
    values: Sequence[float],
    shape: tuple[int, ...],
    dtype: type[np.generic],
    largest: float,
) -> NDArray[Any]:
    expected = math.prod(shape)
    if len(values) != expected or expected == 0:
        shown = "×".join(map(str, shape))
        raise SizeError(name, f"{shown} = {expected} numbers, at least one", len(values))
    read = np.array(values, dtype=dtype).reshape(shape)
    if expected <= FEW and math.hypot(*values) <= min(largest, LARGEST_FLOAT32):
        return read  # a length that is within the limits: so is each number
    reach = float(np.maximum.reduce(np.abs(read), axis=None))  # NaN, inf and too large in one pass
    if not reach < math.inf:
        index = np.unravel_index(int(np.argmin(np.isfinite(read))), shape)
        where = ",".join(str(int(i)) for i in index)
        raise NonFiniteError(f"{name}[{where}]", "a finite number", read[index])
    if reach > largest:
        raise RangeError(name, f"within ±{largest:g}", reach)
    return read
