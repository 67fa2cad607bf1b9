"""Contenders timed in turn, round after round, so that the machine's noise affects all alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter, process_time

QUIET = 0.95  # share of its threads' time that an undisturbed slice got
LEAST_QUIET = 3  # with fewer undisturbed slices, all count


@dataclass(frozen=True)
class Slice:
    """One contender's part of one round."""

    calls: int
    wall_s: float
    cpu_s: float  # of all threads of this process


@dataclass
class Contender:
    """Something that is called again and again, and its timed slices.

    One thread's work is timed by its processor time, so that other processes on the machine do not
    count. Work of several threads or of a GPU (`wall`) is timed by the clock, in undisturbed slices
    if there are enough of them.
    """

    name: str
    run: Callable[[int], object]  # makes that many calls
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
        """Interquartile range of the rates over their median."""
        ordered = sorted(self.rates)
        quarter = len(ordered) // 4
        return (ordered[-1 - quarter] - ordered[quarter]) / self.rate

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
    """The number of calls that takes about `slice_s`, found by calls that are not counted."""
    calls = 1
    while (took := _slice(contender, calls).wall_s) < 0.2 * slice_s:
        calls *= 4
    return max(1, round(calls * slice_s / took))
