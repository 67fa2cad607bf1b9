"""Contenders timed in turn, round after round, so that the machine's noise hits all alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter, process_time

QUIET = 0.95  # share of its threads' time that a quiet slice has got
LEAST_QUIET = 3  # with fewer quiet slices, all count


@dataclass(frozen=True)
class Slice:
    """One contender's part of one round."""

    calls: int
    wall_s: float
    cpu_s: float  # of all threads of this process


@dataclass
class Contender:
    """Something to be called again and again.

    What one thread computes is timed by the processor time that it takes, so that other processes
    on the machine do not count; what several threads or a device compute, by the clock on the
    wall, in the slices that were not disturbed (if there are such).
    """

    name: str
    run: Callable[[int], object]  # makes so many calls
    threads: int = 1
    wall: bool = False
    slices: list[Slice] = field(default_factory=list)

    @property
    def rates(self) -> list[float]:
        """Calls per second of each slice that counts."""
        if not self.wall:
            return [s.calls / s.cpu_s for s in self.slices]
        quiet = [s for s in self.slices if self._share(s) >= QUIET]
        return [s.calls / s.wall_s for s in (quiet if len(quiet) >= LEAST_QUIET else self.slices)]

    @property
    def rate(self) -> float:
        """Median calls per second."""
        return median(self.rates)

    @property
    def spread(self) -> float:
        """Interquartile range over the median."""
        ordered = sorted(self.rates)
        quarter = len(ordered) // 4
        return (ordered[-1 - quarter] - ordered[quarter]) / self.rate

    @property
    def share(self) -> float:
        """Median share of its threads' time that it got: below one, others were running."""
        return median(map(self._share, self.slices))

    def _share(self, s: Slice) -> float:
        return s.cpu_s / s.wall_s / self.threads


def measure(contenders: Sequence[Contender], rounds: int, slice_s: float = 0.25) -> None:
    """Time every contender once per round, for about `slice_s` each."""
    calls = {c.name: _calls(c, slice_s) for c in contenders}
    for _ in range(rounds):
        for contender in contenders:
            contender.slices.append(_slice(contender, calls[contender.name]))


def _slice(contender: Contender, calls: int) -> Slice:
    wall, cpu = perf_counter(), process_time()
    contender.run(calls)
    return Slice(calls, perf_counter() - wall, process_time() - cpu)


def _calls(contender: Contender, slice_s: float) -> int:
    """Calls that take about `slice_s`, after some that are not counted."""
    calls = 1
    while (took := _slice(contender, calls).wall_s) < 0.2 * slice_s:
        calls *= 4
    return max(1, round(calls * slice_s / took))
