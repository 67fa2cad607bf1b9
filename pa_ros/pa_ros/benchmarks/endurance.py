"""A long run of a graph that learns, its replay buffer wrapping: does anything grow?"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pa_ros.core.errors import PaError
from pa_ros.core.report import Report
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.launch_params import load_parameters, merged, packaged, write_parameters
from pa_ros.tools.launcher import Supervisor, node_command
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

SAMPLE_S: Final = 5.0
CAPACITY: Final = 5_000  # frames kept; the replay buffer wraps after so many


class EnduranceError(PaError):
    """A graph that ended, or did not wrap its replay buffer in the time given."""

    code = "bench.endurance"


@dataclass(frozen=True)
class Sample:
    """What a graph is at one moment."""

    at_s: float
    frames: float
    steps_per_s: float
    resident_mb: Mapping[str, float]  # by node
    handles: Mapping[str, int]


def bench_endurance(minutes: float, capacity: int = CAPACITY) -> tuple[Report, list[Sample]]:
    """Growth after the replay buffer has wrapped, from the first fifth of the samples then to the
    last: MB and handles of each process, and steps per second as a share.

    Raises EnduranceError.
    """
    samples = _sampled(minutes * 60, capacity)
    return summary(samples, capacity), samples


def _sampled(seconds: float, capacity: int) -> list[Sample]:
    use_domain(None)
    figures, samples = GraphFigures(), list[Sample]()
    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("endurance") as node:
            watch_diagnostics(node, figures)
            options = [f"learner.replay.capacity_frames={capacity}"]
            parameters = merged(
                load_parameters(packaged("train_2l")),
                {"learner_node": {"out": f"{name}/run", "options": options}},
            )
            path = Path(name) / "params.yaml"
            write_parameters(path, parameters)
            pids = {n: supervisor.start(n, node_command([n], path)) for n in parameters}
            began = time.monotonic()
            while time.monotonic() - began < seconds:
                spin_until(node, lambda: False, SAMPLE_S)
                supervisor.check()
                samples.append(_sample(time.monotonic() - began, figures, pids))
    return samples


def _sample(at_s: float, figures: GraphFigures, pids: Mapping[str, int]) -> Sample:
    return Sample(
        at_s,
        figures.value("learner_node", "frames") or 0.0,
        figures.value("sim_node", "steps_per_s") or 0.0,
        {name: _resident_mb(pid) for name, pid in pids.items()},
        {name: len(list(Path(f"/proc/{pid}/fd").iterdir())) for name, pid in pids.items()},
    )


def _resident_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0


def summary(samples: Sequence[Sample], capacity: int) -> Report:
    """Figures of a run. Raises EnduranceError if the replay buffer did not wrap early enough."""
    wrapped = [sample for sample in samples if sample.frames > capacity]
    if len(wrapped) < 10:
        raise EnduranceError(
            f"endurance: expected {capacity} frames well before the end, got "
            f"{samples[-1].frames if samples else 0:.0f}"
        )
    fifth = max(2, len(wrapped) // 5)
    first, last = wrapped[:fifth], wrapped[-fifth:]
    report: dict[str, float | int | str] = {
        "endurance.minutes": samples[-1].at_s / 60,
        "endurance.frames": samples[-1].frames,
        "endurance.times_wrapped": samples[-1].frames / capacity,
    }
    for name in samples[-1].resident_mb:
        grown = _median(last, "resident_mb", name) - _median(first, "resident_mb", name)
        report[f"endurance.{name}.mb"] = _median(last, "resident_mb", name)
        report[f"endurance.{name}.mb_grown"] = grown
        report[f"endurance.{name}.handles_grown"] = _median(last, "handles", name) - _median(
            first, "handles", name
        )
    speeds = [statistics.median(s.steps_per_s for s in part) for part in (first, last)]
    report["endurance.steps_per_s_first"], report["endurance.steps_per_s_last"] = speeds
    return report


def _median(samples: Sequence[Sample], what: str, name: str) -> float:
    return float(statistics.median(getattr(sample, what)[name] for sample in samples))
