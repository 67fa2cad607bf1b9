"""Pictures of what detectors see: Φ beside the arena (paper, appendix C)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pa_ros.acting.insight import Explanation
from pa_ros.arena.designs import Kind
from pa_ros.arena.model import TABLE_SIDE_M
from pa_ros.arena.render import top_view
from pa_ros.arena.task import ReachTask


def draw_detectors(path: Path, task: ReachTask, explanation: Explanation, program: str) -> None:
    """The arena from above, beside what a learned actor's detectors see in it.

    The table shows Φ transposed and p of the program for every object.
    """
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10, 4), layout="constrained", width_ratios=(1, 1.6)
    )
    half = TABLE_SIDE_M / 2
    left.imshow(top_view(task), extent=(-half, half, -half, half))
    left.set(xlabel="x (m)", ylabel="y (m)", title="the arena from above")
    kinds = [block.kind for block in task.episode.blocks]
    heat_map(right, kinds, explanation.phi, explanation.p, explanation.words)
    right.set_title("learned detectors Φᵀ and relevant objects p")
    figure.suptitle(program, family="monospace", fontsize=10)
    save(figure, path)


def heat_map(
    axes: Axes,
    kinds: Sequence[Kind],
    phi: NDArray[np.floating],
    relevance: NDArray[np.floating],
    words: Sequence[str],
) -> None:
    """Draw Φ [V, N] transposed and p [N] as numbers on colors; `words` [V], `kinds` of blocks."""
    objects = ["HAND", *(str(kind).lower() for kind in kinds)]
    table = np.concatenate([phi, relevance[None]]).T  # [N, V + 1]
    axes.imshow(table, cmap="viridis", vmin=0, vmax=1, aspect="auto")
    axes.set_xticks(range(len(words) + 1), [*words, "p"], rotation=45, ha="right")
    axes.set_yticks(range(len(objects)), objects)
    for (row, column), value in np.ndenumerate(table):
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8,
                  color="black" if value > 0.6 else "white")  # fmt: skip
    axes.axvline(len(words) - 0.5, color="white", linewidth=2)


def save(figure: Figure, path: Path) -> None:
    """Write a PNG and close the figure."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
