"""Learning curves of several seeds, drawn from the tables of `pa_ros experiment`."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pa_ros.evaluation.pictures.drawing import save
from pa_ros.evaluation.scoring.intervals import mean_interval
from pa_ros.evaluation.scoring.tables import TableError
from pa_ros.evaluation.studies.experiments import SOLVED

Float = NDArray[np.float64]
_SEVERAL = ("#268bd2", "#d33682", "#859900", "#b58900")
_CURVES = (
    ("train_greedy.normalized", "training programs", "#b58900"),
    ("eval_greedy.normalized", "held-out programs", "#d33682"),
)


def learning_figure(table: Path) -> Path:
    """Draw every seed, their mean and its 95 % bootstrap interval over seeds; the picture's path.

    Marks the switch of programs, and when the replay buffer has turned over after it, where the
    setting beside the table has one. Raises TableError for a file that is not such a table.
    """
    rows, setting = _read(table)
    seeds = sorted({row["seed"] for row in rows})
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for column, label, color in _CURVES:
        if column in rows[0]:
            _curve(axes, rows, seeds, column, label, color)
    axes.axhline(SOLVED, color="grey", linestyle=":", linewidth=1)
    if switch := setting["switch_frames"]:
        turnover = switch + _replay_frames(setting["learner"])
        for x, text in ((switch, "programs switched"), (turnover, "replay turned over")):
            axes.axvline(x, color="#586e75", linestyle="--", linewidth=1)
            axes.text(x, 0.2, f" {text}", fontsize=8, rotation=90, va="bottom", ha="right",
                      transform=axes.get_xaxis_transform())  # fmt: skip
    axes.set(
        xlabel="frames (control steps)",
        ylabel="normalized score (random 0, scripted 1)",
        ylim=(-0.1, 1.05),
        title=f"{setting['design']}, {setting['network']}, protocol {setting['protocol']}, "
        f"{setting.get('arm', 'jaco')}, {setting['preset']} preset: "
        f"{len(seeds)} seed{'s' if len(seeds) > 1 else ''}",
    )
    axes.legend(loc="lower right", frameon=False)
    picture = table.with_suffix(".png")
    save(figure, picture)
    return picture


def algorithms_figure(path: Path, tables: Mapping[str, Path]) -> None:
    """Held-out scores of the tables, by what their curves are called."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    column, _, _ = _CURVES[1]
    for (label, table), color in zip(tables.items(), _SEVERAL, strict=False):
        rows, setting = _read(table)
        seeds = sorted({row["seed"] for row in rows})
        _curve(axes, rows, seeds, column, f"{label}, {len(seeds)} seeds", color)
    axes.axhline(SOLVED, color="grey", linestyle=":", linewidth=1)
    axes.set(
        xlabel="frames (control steps)",
        ylabel="held-out score (random 0, scripted 1)",
        ylim=(-0.1, 1.05),
        title=f"{setting['design']}, {setting['network']}, protocol {setting['protocol']}",
    )
    axes.legend(loc="lower right", frameon=False)
    save(figure, path)


def _curve(
    axes: Axes,
    rows: list[dict[str, float]],
    seeds: list[float],
    column: str,
    label: str,
    color: str,
) -> None:
    scores: dict[float, list[float]] = {}
    for seed in seeds:
        own = [(row["frames"], row[column]) for row in rows if row["seed"] == seed]
        axes.plot(*zip(*own, strict=True), color=color, alpha=0.35, linewidth=0.8)
        for frames, score in own:
            scores.setdefault(frames, []).append(score)
    shared = sorted(frames for frames, values in scores.items() if len(values) == len(seeds))
    intervals = [mean_interval(np.array(scores[frames])) for frames in shared]
    axes.plot(shared, [i.mean for i in intervals], color=color, linewidth=2, label=label)
    if len(seeds) > 1:
        axes.fill_between(
            shared,
            [i.low for i in intervals],
            [i.high for i in intervals],
            color=color,
            alpha=0.2,
            linewidth=0,
        )


def is_curves(table: Path) -> bool:
    """Whether a CSV holds learning curves, and its setting is beside it."""
    with table.open() as file:
        return file.readline().startswith("seed,frames,") and table.with_suffix(".json").exists()


def _read(table: Path) -> tuple[list[dict[str, float]], dict[str, Any]]:
    try:
        with table.open(newline="") as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
        setting = json.loads(table.with_suffix(".json").read_text())
        if rows and {"seed", "frames"} <= rows[0].keys():
            return rows, setting
        raise ValueError("expected columns seed and frames, and at least one row")
    except (OSError, ValueError, TypeError) as error:
        raise TableError(f"{table}: {error}") from error


def _replay_frames(learner: Mapping[str, Any]) -> int:
    """Capacity of the replay buffer; tables of 0.1 hold the learner's settings without parts."""
    parts = learner.get("replay", {"capacity_frames": learner.get("replay_frames")})
    return int(parts["capacity_frames"])
