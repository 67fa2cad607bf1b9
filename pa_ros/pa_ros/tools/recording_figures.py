"""What a recording is told by while it runs, and when it has ended. Needs no ROS."""

from __future__ import annotations

import time
from collections.abc import Callable

from pa_ros.core.report import Report
from pa_ros.core.software import device, versions


class RecordingFigures:
    """Messages, rates and losses per topic, size, processor time."""

    def __init__(
        self,
        topics: dict[str, int],
        counted: Callable[[], tuple[dict[str, int], dict[str, int]]],
    ) -> None:
        """`counted` gives messages and losses by topic so far."""
        self.size = 0  # bytes on disk
        self._counted = counted
        self._started, self._cpu = time.monotonic(), time.process_time()
        self._before = (self._started, topics)

    def late(self, duration_s: float | None) -> bool:
        """Whether the time is up."""
        return duration_s is not None and time.monotonic() - self._started >= duration_s

    def rows(self) -> list[tuple[str, str]]:
        """(label, text) for the live table."""
        counts, lost = self._counted()
        now, (then, before) = time.monotonic(), self._before
        self._before = (now, counts)
        elapsed = max(now - then, 1e-9)
        rows = [
            (name, f"{count:>9}  {(count - before.get(name, 0)) / elapsed:8.1f}/s"
             f"  lost {lost.get(name, 0)}")
            for name, count in counts.items()
        ]  # fmt: skip
        return [*rows, ("size", f"{self.size / 1e6:.1f} MB"), ("processor", f"{self._share():.1%}")]

    def line(self) -> str:
        """The same in one line."""
        counts, lost = self._counted()
        return (
            f"{sum(counts.values())} messages  {self.size / 1e6:.1f} MB  lost {sum(lost.values())}"
        )

    def report(self) -> Report:
        """Flat figures of the whole recording."""
        counts, lost = self._counted()
        wall_s = max(time.monotonic() - self._started, 1e-9)
        report: dict[str, float | int | str] = {
            "record.wall_s": wall_s,
            "record.messages": sum(counts.values()),
            "record.lost": sum(lost.values()),
            "record.megabytes": self.size / 1e6,
            "record.megabytes_per_min": self.size / 1e6 / wall_s * 60,
            "record.cpu_share": self._share(),
        }
        for name, count in counts.items():
            report[f"record.topic.{name}.messages"] = count
            report[f"record.topic.{name}.lost"] = lost.get(name, 0)
        return {**report, "device": device(), "threads": 1, "versions": versions()}

    def _share(self) -> float:
        """Processor time of this process per wall time, since the start."""
        wall_s = max(time.monotonic() - self._started, 1e-9)
        return (time.process_time() - self._cpu) / wall_s
