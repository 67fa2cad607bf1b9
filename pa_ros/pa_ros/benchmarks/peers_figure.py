"""Picture of other libraries' agents beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from pa_ros.benchmarks.peers import Score
from pa_ros.evaluation.pictures.drawing import save

COLUMNS = {"train_success": "trained programs", "held_out_success": "held-out program"}


def draw_peers(path: Path, scores: Sequence[Score]) -> None:
    """Share of episodes that end satisfied against seconds of training, a line for each run."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
    names = list(dict.fromkeys(row.contender for row in scores))
    for plot, (field, title) in zip(axes, COLUMNS.items(), strict=True):
        for color, name in enumerate(names):
            for seed in sorted({row.seed for row in scores if row.contender == name}):
                run = [row for row in scores if (row.contender, row.seed) == (name, seed)]
                shares = [getattr(row, field) for row in run]
                label = None if seed else name
                plot.plot([row.seconds for row in run], shares, color=f"C{color}", label=label)
        plot.set(
            xlabel="training (s of one processor)", title=title, xscale="log", ylim=(-0.03, 1.03)
        )
        plot.grid(alpha=0.3)
    axes[0].set_ylabel("episodes that end satisfied")
    axes[0].legend(frameon=False)
    save(figure, path)
