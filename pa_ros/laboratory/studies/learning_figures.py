"""Pictures of learning curves and of variants, from the tables of `pa_ros experiment`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from laboratory.studies.experiments import SOLVED, SeedSummary
from laboratory.studies.tables import read_curves, read_setting
from laboratory.studies.variants import Variant
from pa_ros.arena.skills import NORMALIZED, SUCCESS
from pa_ros.evaluation.drawing import save
from pa_ros.evaluation.scores import mean_interval

Float = NDArray[np.float64]
Curves = Mapping[int, Sequence[Mapping[str, float]]]
"""Rows of learning curves, by seed."""
Scores = Mapping[int, Mapping[float, float]]
"""One score by frames, for each seed."""
_CURVES = (
    ("train_greedy", "training programs", "#b58900"),
    ("eval_greedy", "held-out programs", "#d33682"),
)
_SCORES = {
    NORMALIZED: "normalized score (random 0, scripted 1)",
    SUCCESS: "share of episodes that succeed",
}


def learning_figure(table: Path) -> Path:
    """Draw the seeds of a table beside it and return the picture's path.

    If the training programs were switched, marks that and when the replay buffer had turned over.
    Raises EvaluationError for a file that is no table of curves.
    """
    curves, setting = _read(table)
    count = len(curves)
    figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
    score = setting.get("score", NORMALIZED)
    for name, label, color in _CURVES:
        column = f"{name}.{score}"
        if column in next(iter(curves.values()))[0]:
            _curve(axes, _scores(curves, column), label, color)
    if switch := setting["switch_frames"]:
        turnover = switch + setting["learner"]["replay"]["capacity_frames"]
        for x, text in ((switch, "programs switched"), (turnover, "replay turned over")):
            axes.axvline(x, color="#586e75", linestyle="--", linewidth=1)
            axes.text(x, 0.35, f" {text}", fontsize=8, rotation=90, va="bottom", ha="right",
                      transform=axes.get_xaxis_transform())  # fmt: skip
    title = (
        f"{setting['design']}, {setting['network']}, recipe {setting['recipe']}, "
        f"{setting.get('arm', 'jaco')}, {setting['preset']} preset: "
        f"{count} seed{'s' if count > 1 else ''}"
    )
    _finish(figure, axes, title, score)
    picture = table.with_suffix(".png")
    save(figure, picture)
    return picture


def is_curves(table: Path) -> bool:
    """Whether a CSV file holds learning curves, with the setting beside it."""
    if not (table.is_file() and table.with_suffix(".json").exists()):
        return False
    with table.open("rb") as file:
        return file.readline().startswith(b"seed,frames,")


def _read(table: Path) -> tuple[Curves, dict[str, Any]]:
    needed = ("design", "network", "recipe", "preset", "switch_frames", "learner")
    return read_curves(table), read_setting(table, *needed)


def _scores(curves: Curves, column: str) -> Scores:
    return {
        seed: {row["frames"]: row[column] for row in rows} for seed, rows in sorted(curves.items())
    }


def _curve(axes: Axes, scores: Scores, label: str, color: str) -> None:
    """Draw each seed as a thin line, and the mean of several with its 95 % interval.

    The mean ends where the shortest seed ends.
    """
    for own in scores.values():
        axes.plot(list(own), list(own.values()), linewidth=0.8, alpha=0.4, color=color)
    frames = sorted(set.intersection(*(set(own) for own in scores.values())))
    means = [mean_interval(np.array([own[at] for own in scores.values()])) for at in frames]
    axes.plot(frames, [i.mean for i in means], linewidth=2, label=label, color=color)
    axes.fill_between(frames, [i.low for i in means], [i.high for i in means], color=color,
                      alpha=0.2, linewidth=0)  # fmt: skip


def _finish(figure: Figure, axes: Axes, title: str, score: str = NORMALIZED) -> None:
    """Add scales, the level that counts as solved, and the legend."""
    axes.axhline(SOLVED, color="grey", linestyle=":", linewidth=1, label=f"{SOLVED}: solved")
    axes.set(xlabel="frames (control steps)", ylabel=_SCORES[score], ylim=(-0.1, 1.05), title=title)
    axes.title.set_fontsize(10)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda frames, _: f"{frames:,.0f}"))
    axes.plot([], [], color="grey", linewidth=0.8, alpha=0.6, label="each seed")
    axes.fill_between([], [], color="grey", alpha=0.25, label="95 % interval of the mean")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)


def short(changed: str) -> str:
    """A variant's changed setting, such as "discount=0.99" for "learner.updates.discount=0.99"."""
    return ", ".join(re.sub(r"^.*\.(?=\w+=)", "", part) for part in changed.split())


def variants_figure(
    path: Path, rows: Sequence[Variant], seeds: Mapping[str, Sequence[SeedSummary]]
) -> None:
    """Draw held-out scores and frames to solve; `seeds` of each variant by its label."""
    figure, (scores, frames) = plt.subplots(
        1, 2, figsize=(11, 1.4 + 0.32 * len(rows)), sharey=True, layout="constrained"
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
    names = [short(row.changed) or "nothing changed" for row in reversed(rows)]
    scores.set_yticks(range(len(rows)), names)
    scores.axvline(SOLVED, color="grey", linestyle=":", linewidth=1)
    scores.set(xlabel=f"held-out score after {rows[0].frames:,.0f} frames", xlim=(-0.1, 1.05))
    frames.set(
        xlabel=f"frames until {SOLVED}, and never below again", xlim=(0, 1.25 * rows[0].frames)
    )
    frames.xaxis.set_major_locator(MaxNLocator(5))
    frames.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    figure.suptitle(
        f"{path.stem.removesuffix('-variants')}, something changed: each dot is a seed, the line "
        "the 95 % interval of their mean",
        fontsize=10,
    )
    save(figure, path)
