"""Learning curves of several seeds, drawn from the tables of `pa_ros experiment`."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from itertools import cycle, product
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from pa_ros.evaluation.pictures.drawing import save
from pa_ros.evaluation.scoring.intervals import Interval, mean_interval
from pa_ros.evaluation.scoring.tables import TableError, read_setting
from pa_ros.evaluation.studies.experiments import SOLVED

Float = NDArray[np.float64]
Scores = Mapping[float, Mapping[float, float]]
"""Of each seed, by frames."""
FEW = 4  # seeds up to which each is a line of its own: their mean would say nothing of any
_STYLES = ("-", "--", ":", "-.")
_MARKERS = ("", "o", "s", "^")
_SEVERAL = ("#268bd2", "#d33682", "#859900", "#b58900")
_CURVES = (
    ("train_greedy.normalized", "training programs", "#b58900"),
    ("eval_greedy.normalized", "held-out programs", "#d33682"),
)


def learning_figure(table: Path) -> Path:
    """Draw the seeds of a table, many with their mean and its 95 % interval; the picture's path.

    Marks the switch of programs, and when the replay buffer has turned over after it, where the
    setting beside the table has one. Raises TableError for a file that is not such a table.
    """
    rows, setting = _read(table)
    count = len({row["seed"] for row in rows})
    figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
    shown = [curve for curve in _CURVES if curve[0] in rows[0]]
    if not shown:
        raise TableError(f"{table}: expected a column of {[c for c, _, _ in _CURVES]}, got none")
    for column, label, color in shown:
        _curve(axes, _scores(rows, column), label, color)
    if switch := setting["switch_frames"]:
        turnover = switch + _replay_frames(setting["learner"])
        for x, text in ((switch, "programs switched"), (turnover, "replay turned over")):
            axes.axvline(x, color="#586e75", linestyle="--", linewidth=1)
            axes.text(x, 0.35, f" {text}", fontsize=8, rotation=90, va="bottom", ha="right",
                      transform=axes.get_xaxis_transform())  # fmt: skip
    title = (
        f"{setting['design']}, {setting['network']}, protocol {setting['protocol']}, "
        f"{setting.get('arm', 'jaco')}, {setting['preset']} preset: "
        f"{count} seed{'s' if count > 1 else ''}"
    )
    _finish(figure, axes, title, [_scores(rows, column) for column, _, _ in shown])
    picture = table.with_suffix(".png")
    save(figure, picture)
    return picture


def algorithms_figure(path: Path, tables: Mapping[str, Path]) -> None:
    """Held-out scores of the tables, by what their curves are called."""
    figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
    column, _, _ = _CURVES[1]
    found = []
    looks = cycle(product(_MARKERS, _SEVERAL))
    for (label, table), (marker, color) in zip(tables.items(), looks, strict=False):
        rows, setting = _read(table)
        found.append(_scores(rows, column))
        _curve(axes, found[-1], f"{label}, {len(found[-1])} seeds, held out", color, marker)
    title = f"{setting['design']}, {setting['network']}, protocol {setting['protocol']}"
    _finish(figure, axes, title, found)
    save(figure, path)


def _scores(rows: Sequence[Mapping[str, float]], column: str) -> Scores:
    seeds = sorted({row["seed"] for row in rows})
    return {
        seed: {row["frames"]: row[column] for row in rows if row["seed"] == seed} for seed in seeds
    }


def _curve(axes: Axes, scores: Scores, label: str, color: str, marker: str = "") -> None:
    """Few seeds each in a style; many thin, with their mean over those that came so far.

    `marker` is at some points of all but the thin ones.
    """
    many = len(scores) > FEW
    thick: dict[str, Any] = {"marker": marker, "markevery": 0.1, "markersize": 5, "color": color}
    for own, style in zip(scores.values(), _STYLES * len(scores), strict=False):
        thin = {"linewidth": 0.8, "alpha": 0.35, "color": color}
        axes.plot(list(own), list(own.values()), **(thin if many else thick | {"linestyle": style}))
    axes.plot([], [], linewidth=2, label=label, **thick)
    if many:
        frames, intervals = _means(scores)
        axes.plot(frames, [i.mean for i in intervals], linewidth=2, **thick)
        axes.fill_between(
            frames, [i.low for i in intervals], [i.high for i in intervals],
            color=color, alpha=0.2, linewidth=0,
        )  # fmt: skip


def _means(scores: Scores) -> tuple[list[float], list[Interval]]:
    """Over the seeds that came so far; up to where no more than FEW go on."""
    frames = sorted({at for own in scores.values() for at in own})
    values = [np.array([own[at] for own in scores.values() if at in own]) for at in frames]
    enough = [(at, mean_interval(v)) for at, v in zip(frames, values, strict=True) if len(v) > FEW]
    return [at for at, _ in enough], [interval for _, interval in enough]


def _finish(figure: Figure, axes: Axes, title: str, drawn: Sequence[Scores]) -> None:
    """Scales, the level that counts as solved, and below what the lines are."""
    axes.axhline(SOLVED, color="grey", linestyle=":", linewidth=1, label=f"{SOLVED}: solved")
    axes.set(
        xlabel="frames (control steps)",
        ylabel="normalized score (random 0, scripted 1)",
        ylim=(-0.1, 1.05),
        title=title,
    )
    axes.title.set_fontsize(10)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda frames, _: f"{frames:,.0f}"))
    if any(len(scores) > FEW for scores in drawn):
        axes.plot([], [], color="grey", linewidth=0.8, alpha=0.6, label="each seed")
        axes.plot([], [], color="grey", linewidth=2, label="mean of the seeds")
        axes.fill_between([], [], color="grey", alpha=0.25, label="95 % interval of the mean")
    elif max(map(len, drawn)) > 1:
        for seed, style in zip(drawn[0], _STYLES, strict=False):
            axes.plot([], [], color="grey", linestyle=style, label=f"seed {seed:.0f}")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)


_SHOWN = ("design", "network", "protocol", "preset", "switch_frames", "learner")


def is_curves(table: Path) -> bool:
    """Whether a CSV holds learning curves, and its setting is beside it."""
    if not (table.is_file() and table.with_suffix(".json").exists()):
        return False
    with table.open("rb") as file:
        return file.readline().startswith(b"seed,frames,")


def _read(table: Path) -> tuple[list[dict[str, float]], dict[str, Any]]:
    try:
        with table.open(newline="") as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
        if rows and {"seed", "frames"} <= rows[0].keys():
            setting = read_setting(table, *_SHOWN)
            _ = int(setting["switch_frames"]), _replay_frames(setting["learner"])
            return rows, setting
        raise ValueError("expected columns seed and frames, and at least one row")
    except (OSError, ValueError, TypeError, KeyError, AttributeError, csv.Error) as error:
        raise TableError(f"{table}: {error!r}") from error


def _replay_frames(learner: Mapping[str, Any]) -> int:
    """Capacity of the replay buffer; tables of 0.1 hold the learner's settings without parts."""
    parts = learner.get("replay", {"capacity_frames": learner.get("replay_frames")})
    return int(parts["capacity_frames"])
