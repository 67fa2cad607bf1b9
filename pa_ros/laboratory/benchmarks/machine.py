"""How fast one thread of this machine multiplies matrices and evaluates functions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter

import numpy as np
import torch

from laboratory.benchmarks.cost import Rates
from pa_ros.core.experience import Float32
from pa_ros.native.library import library

Ways = list[Callable[[], object]]

_LINE = 16  # floats
_SAMPLES = 2048  # of a function: 8 KiB
_PASSES = 100  # over them
_SHAPES = ((64, 160, 320), (512, 512, 512))  # rows, depth, columns: ours, and a square


def measure_rates(parameter_bytes: float, repeats: int = 30) -> Rates:
    """The best rates of the native library, torch and NumPy, each repeated."""
    x = np.random.default_rng(0).uniform(-3.0, 3.0, _SAMPLES).astype(np.float32)
    many, e = np.tile(x, _PASSES), np.exp(2.0 * x)
    t, size = torch.from_numpy(many), many.size
    exponentials: Ways = [partial(np.exp, many), partial(torch.exp, t)]
    tanhs: Ways = [partial(np.tanh, many), partial(torch.tanh, t)]
    exponentials.append(elementwise("EXPONENTIAL", x, x, _PASSES))
    tanhs.append(elementwise("TANH", x, x, _PASSES))
    return Rates(
        flops=max(_matrix_rate(shape, repeats) for shape in _SHAPES),
        exponentials=_rate(size, exponentials, repeats),
        tanhs=_rate(size, tanhs, repeats),
        pair_tanhs=_rate(size, [elementwise("TANH_OF_SUM", 0.5 * e, e, _PASSES)], repeats),
        bytes=_copy_rate(int(parameter_bytes), repeats),
    )


def elementwise(function: str, x: Float32, y: Float32, repeats: int = 1) -> Callable[[], Float32]:
    """One of the native library's functions, on arrays whose size is a multiple of 16."""
    native = library()
    a, b, out = (aligned(x.size) for _ in range(3))
    a[:], b[:] = x, y

    def compute() -> Float32:
        native.elementwise(native.Function[function], a, b, out, repeats)
        return out

    return compute


def product(a: Float32, b: Float32) -> Callable[[], Float32]:
    """The native library's matrix product; the number of columns is a multiple of 16."""
    (rows, depth), columns = a.shape, b.shape[1]
    x = np.ascontiguousarray(a)
    y, out = (aligned(n * columns).reshape(n, columns) for n in (depth, rows))
    y[:] = b

    def compute() -> Float32:
        library().product(x, y, out)
        return out

    return compute


def aligned(size: int) -> Float32:
    """Zeros that start at a cache line."""
    memory = np.zeros(size + _LINE, np.float32)
    start = -(memory.ctypes.data // 4) % _LINE
    return memory[start : start + size]


def _matrix_rate(shape: tuple[int, int, int], repeats: int) -> float:
    """Multiplications and additions per microsecond."""
    rows, depth, columns = shape
    rng = np.random.default_rng(0)
    a, b = (rng.random(size, np.float32) for size in ((rows, depth), (depth, columns)))
    s, t = torch.from_numpy(a), torch.from_numpy(b)
    out, torch_out = np.empty((rows, columns), np.float32), torch.empty(rows, columns)
    ways: Ways = [partial(np.matmul, a, b, out), partial(torch.mm, s, t, out=torch_out)]
    ways.append(product(a, b))
    return _rate(2.0 * rows * depth * columns, ways, repeats)


def _copy_rate(size: int, repeats: int) -> float:
    source = np.zeros(size, np.uint8)
    return _rate(2.0 * size, [partial(np.copyto, np.empty_like(source), source)], repeats)


def _rate(operations: float, ways: Ways, repeats: int) -> float:
    return max(1e-6 * operations / _best_s(way, repeats) for way in ways)


def _best_s(way: Callable[[], object], repeats: int, least_s: float = 1e-3) -> float:
    """Seconds of one call: the shortest of `repeats` rounds of at least `least_s` each."""
    way()
    start = perf_counter()
    way()
    calls = max(1, int(least_s / max(perf_counter() - start, 1e-7)))
    best = float("inf")
    for _ in range(repeats):
        start = perf_counter()
        for _ in range(calls):
            way()
        best = min(best, (perf_counter() - start) / calls)
    return best
