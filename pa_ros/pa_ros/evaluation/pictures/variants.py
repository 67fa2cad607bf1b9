"""The picture of an experiment's variants: every seed a dot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt

from pa_ros.evaluation.pictures.drawing import save
from pa_ros.evaluation.studies.experiments import SOLVED, SeedSummary
from pa_ros.evaluation.studies.variants import Variant


def variants_figure(
    path: Path, rows: Sequence[Variant], seeds: Mapping[str, Sequence[SeedSummary]]
) -> None:
    """Held-out scores and frames to solve, of each variant's `seeds` (by its label)."""
    figure, (scores, frames) = plt.subplots(
        1, 2, figsize=(9, 1 + 0.32 * len(rows)), sharey=True, layout="constrained"
    )
    for y, row in enumerate(reversed(rows)):
        color = "#d33682" if row.changed else "#268bd2"
        own = seeds[row.label]
        scores.plot([s.held_out_at_end for s in own], [y] * len(own), "o", color=color, alpha=0.6)
        scores.plot([row.low, row.high], [y, y], color=color, linewidth=1)
        solved = [s.frames_to_solve for s in own if not math.isnan(s.frames_to_solve)]
        frames.plot(solved, [y] * len(solved), "o", color=color, alpha=0.6)
        if missing := len(own) - len(solved):
            frames.text(1.0, y, f"{missing} never ", transform=frames.get_yaxis_transform(),
                        ha="right", va="center", fontsize=8)  # fmt: skip
    names = [row.label.partition(".")[2] or "as it is" for row in reversed(rows)]
    scores.set_yticks(range(len(rows)), names)
    scores.axvline(SOLVED, color="grey", linestyle=":", linewidth=1)
    scores.set(xlabel=f"held-out score after {rows[0].frames:g} frames", xlim=(-0.1, 1.05))
    frames.set(xlabel=f"frames to {SOLVED} to stay", xlim=(0, 1.25 * rows[0].frames))
    figure.suptitle(f"{rows[0].label.partition('.')[0]}: each dot is a seed", fontsize=11)
    save(figure, path)
