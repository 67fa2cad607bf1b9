"""Picture of how the time of an update grows."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from pa_ros.benchmarks.growth import AXES, FIGURES, series
from pa_ros.core.report import Report
from pa_ros.evaluation.pictures.drawing import save

STYLES = {
    "fused": {"color": "#268bd2", "marker": "o"},
    "torch": {"color": "#cb4b16", "marker": "s"},
    "floor": {"color": "grey", "linestyle": ":"},
}


def growth_figure(path: Path, report: Report) -> None:
    """Milliseconds of an update against each size, both axes logarithmic."""
    figure, panels = plt.subplots(
        1, len(AXES), figsize=(11, 3.6), layout="constrained", sharey=True
    )
    for axes, axis in zip(panels, AXES, strict=True):
        for name in FIGURES:
            values = [1e-3 * us for us in series(report, axis, name)]
            axes.plot(axis.values, values, label=name, **STYLES[name])
        axes.set(xscale="log", yscale="log", xlabel=axis.title)
        axes.set_xticks(axis.values, axis.values)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("one update (ms)")
    panels[0].legend(frameon=False)
    save(figure, path)
