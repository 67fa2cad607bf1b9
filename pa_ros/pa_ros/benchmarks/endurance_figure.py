"""A long run as a picture: memory, file handles and speed over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pa_ros.benchmarks.endurance import Sample


def draw_endurance(path: Path, samples: Sequence[Sample], capacity: int) -> None:
    """Three panels over minutes, with a line where the replay buffer wraps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 6), layout="constrained")
    memory, handles, speed = figure.subplots(3, sharex=True)
    minutes = [sample.at_s / 60 for sample in samples]
    for name in samples[-1].resident_mb:
        memory.plot(minutes, [sample.resident_mb[name] for sample in samples], label=name)
        handles.plot(minutes, [sample.handles[name] for sample in samples], label=name)
    speed.plot(minutes, [sample.steps_per_s for sample in samples], color="black")
    wraps = next((s.at_s / 60 for s in samples if s.frames > capacity), None)
    for axis, label in ((memory, "resident, MB"), (handles, "file handles"), (speed, "steps/s")):
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0)
        if wraps is not None:
            axis.axvline(wraps, color="grey", linestyle=":")
    memory.legend(fontsize="small")
    speed.set_xlabel("minutes (dotted: the replay buffer is full, and wraps)")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
