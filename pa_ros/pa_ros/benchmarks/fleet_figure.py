"""Picture of what several arenas are worth to one learner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from pa_ros.benchmarks.fleet import GOAL, Run
from pa_ros.evaluation.pictures.drawing import save

COLORS = {1: "#268bd2", 2: "#2aa198", 4: "#cb4b16", 8: "#6c71c4"}


def draw_fleet(path: Path, runs: Sequence[Run]) -> None:
    """Held-out score against wall-clock of throttled fleets; frames per second of unthrottled."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    _curves(left, [run for run in runs if run.throttled])
    _rates(right, [run for run in runs if not run.throttled])
    save(figure, path)


def _curves(axes: Axes, runs: Sequence[Run]) -> None:
    named: set[int] = set()
    for run in sorted(runs, key=lambda run: run.arenas):
        label = f"{run.arenas} arenas" if run.arenas > 1 else "1 arena"
        shown = [max(-0.1, score) for *_, score in run.curve]
        axes.plot(
            [seconds for seconds, *_ in run.curve],
            shown,
            color=COLORS.get(run.arenas, "grey"),
            label=None if run.arenas in named else label,
        )
        named.add(run.arenas)
    axes.axhline(GOAL, color="grey", linestyle=":")
    axes.set(xlabel="wall-clock (s)", ylabel="held out, normalized", title="100 steps/s each")
    axes.grid(alpha=0.3)
    if named:
        axes.legend(frameon=False)


def _rates(axes: Axes, runs: Sequence[Run]) -> None:
    for ratio in sorted({run.updates_per_frame for run in runs}, reverse=True):
        those = sorted(
            (run for run in runs if run.updates_per_frame == ratio), key=lambda run: run.arenas
        )
        label = f"{ratio:g} updates/frame"
        sizes = [run.arenas for run in those]
        axes.plot(sizes, [run.frames_per_s for run in those], marker="o", label=label)
    axes.set(xlabel="arenas", ylabel="frames/s", title="as fast as it goes", ylim=(0, None))
    axes.grid(alpha=0.3)
    if runs:
        axes.legend(frameon=False)
