"""Pictures of zero-shot scores, and of detectors in their best and worst scenes.

(paper, figures 5 and 6 and appendix "Detector visualizations")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from laboratory.studies.detectors import (
    DetectorLook,
    DetectorView,
    detector_conditions,
    extremes,
    named,
)
from laboratory.studies.generalization import ConditionRow, Summary, summarize
from pa_ros.agents import TrainedAgent
from pa_ros.arena import ReachTask
from pa_ros.arena.model import TABLE_SIDE_M
from pa_ros.arena.render import top_view
from pa_ros.evaluation.conditions import RANDOM_WEIGHTS
from pa_ros.evaluation.drawing import heat_map, save

BOX, SEEDS, SCRIPT, BLIND_MARK = "#8fb8de", "#1f4e79", "#555555", "#c0392b"
WORDS = {
    "train": "trained programs",
    RANDOM_WEIGHTS: "random weights",
    "eval": "held-out programs",
    "only-color": "color alone",
    "only-shape": "shape alone",
    "not-color": "not a color",
    "not-shape": "not a shape",
    "ignore-new": "new kinds beside it",
    "reach-new-shape": "new shape",
    "reach-new-color": "new color",
    "reach-new-both": "both new",
}


def generalization_figure(path: Path, rows: Sequence[ConditionRow], title: str) -> None:
    """Draw the reward per step under each condition: boxes over all episodes, a dot for each seed.

    Lines show the means of the scripted reference and of the best blind one on the same episodes.
    Whiskers reach the 5th and the 95th percentile.
    """
    summaries = summarize(rows)
    figure, axes = plt.subplots(
        figsize=(max(7.0, 0.5 * len(summaries) + 1.5), 4.6), layout="constrained"
    )
    for x, summary in enumerate(summaries):
        _column(axes, x, [row for row in rows if row.condition == summary.condition], summary)
    axes.fill_between([], [], color=BOX, label="middle half of the episodes (whiskers 5 % to 95 %)")
    axes.plot([], [], "o", color=SEEDS, markersize=4, label="mean of each seed")
    axes.plot([], [], color=SCRIPT, linewidth=2, label="scripted, knows the target")
    axes.plot([], [], color=BLIND_MARK, linewidth=2, label="best that ignores the program")
    names = [in_words(summary.condition) for summary in summaries]
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
    axes.set(ylabel="reward per step", ylim=(-1.05, 1.05), title=title)
    # Below the axes, because the boxes leave no free corner.
    figure.legend(loc="outside lower center", fontsize=8, ncols=4, frameon=False)
    save(figure, path)


def in_words(condition: str) -> str:
    kind, _, count = condition.rpartition("-")
    counted = {"blocks": f"{count} blocks", "depth": f"programs {count} deep"}
    return WORDS.get(condition) or counted.get(kind, condition)


def _column(axes: Axes, x: int, rows: Sequence[ConditionRow], summary: Summary) -> None:
    box = axes.boxplot(
        [row.reward for row in rows],
        positions=[x],
        widths=0.62,
        whis=(5, 95),
        patch_artist=True,
        manage_ticks=False,
        flierprops={"marker": ".", "markersize": 2, "markeredgecolor": "#999999"},
        medianprops={"color": "black"},
    )
    box["boxes"][0].set(facecolor=BOX, linewidth=0.8)
    seeds = list(dict.fromkeys(row.seed for row in rows))
    means = [np.mean([row.reward for row in rows if row.seed == seed]) for seed in seeds]
    shifts = np.linspace(-0.2, 0.2, len(seeds)) if len(seeds) > 1 else [0.0]
    axes.plot(x + np.asarray(shifts), means, "o", color=SEEDS, markersize=3, zorder=4)
    scripted = np.mean([row.scripted for row in rows])
    blind = np.mean([getattr(row, summary.blind) for row in rows])
    for level, color in ((scripted, SCRIPT), (blind, BLIND_MARK)):
        axes.hlines(float(level), x - 0.42, x + 0.42, color=color, linewidth=2, zorder=3)


def detector_figure(path: Path, agent: TrainedAgent, episodes: int, title: str) -> None:
    """Draw the arena, Φ transposed and p, for known and unseen properties, a good and a bad case.

    The good case is the look with the largest margin of the condition's episodes, the bad one that
    with the smallest (`detectors.DetectorLook.margin`).
    """
    conditions = detector_conditions(agent.design)
    count = 2 * len(conditions)
    figure, axes = plt.subplots(
        count, 2, figsize=(9.5, 2.3 * count + 0.6), width_ratios=(1, 1.9), layout="constrained"
    )
    view = DetectorView(agent)
    row = 0
    for condition in conditions:
        for case, look in zip(
            ("best", "worst"), extremes(list(view.looks(condition, episodes))), strict=True
        ):
            _case(axes[row], view.show(look), look)
            axes[row][0].set_ylabel(
                f"{in_words(condition)}: {case}\nmargin {look.margin:+.2f}", fontsize=9
            )
            row += 1
    for _, table in axes[:-1]:
        table.set_xticklabels([])
    figure.suptitle(title, fontsize=10)
    save(figure, path)


def _case(axes: Sequence[Axes], task: ReachTask, look: DetectorLook) -> None:
    picture, table = axes
    half = TABLE_SIDE_M / 2
    picture.imshow(top_view(task, 300), extent=(-half, half, -half, half))
    picture.set(xticks=(-half, 0, half), yticks=(-half, 0, half))
    picture.set_xlabel("x (m)", fontsize=7, labelpad=1)
    picture.tick_params(labelsize=6)
    picture.set_title(f"target: {named(look)}", fontsize=8)
    kinds = [block.kind for block in look.episode.blocks]
    heat_map(table, kinds, look.phi, look.p, look.words)
    table.tick_params(labelsize=7)
    table.set_title(str(look.episode.program), fontsize=6.5, family="monospace")
