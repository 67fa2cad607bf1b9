"""Pictures of one run: its learning curve, and Φ beside the arena (paper, appendix C)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray
from PIL import Image

from pa_ros.arena.appearance import look_of
from pa_ros.arena.designs import Kind
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Observation
from pa_ros.language import MIN_MAX, parse, relevance
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.config import actor_config
from pa_ros.networks.inference import TorchActor


def learning_curve(
    path: Path,
    frames: Sequence[float],
    train: Sequence[float],
    held_out: Sequence[float],
    title: str,
    references: tuple[float, float] | None = None,
) -> None:
    """Draw reward per step against frames; NaN leaves a gap.

    `train` is of exploring episodes, `held_out` of greedy ones with programs never trained on.
    `references` are the rewards of random and script on the held-out programs.
    """
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for values, label, color in (
        (train, "train, exploring", "#b58900"),
        (held_out, "held out, greedy", "#d33682"),
    ):
        kept = [(x, y) for x, y in zip(frames, values, strict=True) if np.isfinite(y)]
        if kept:
            axes.plot(*zip(*kept, strict=True), label=label, color=color, marker=".")
    for level, name in zip(references or (), ("random", "scripted"), strict=False):
        axes.axhline(level, color="grey", linestyle=":", linewidth=1)
        axes.text(0.995, level, name, transform=axes.get_yaxis_transform(), ha="right",
                  va="bottom", fontsize=8, color="grey")  # fmt: skip
    axes.set(xlabel="frames (control steps)", ylabel="reward per step", title=title)
    axes.set_ylim(-1.05, 1)
    axes.legend(loc="upper left", frameon=False)
    save(figure, path)


def draw_detectors(
    path: Path, checkpoint: Path, task: ReachTask, observation: Observation, program: str
) -> None:
    """The arena from above, beside what a learned actor's detectors see in this observation.

    The table shows Φ transposed and p of the program for every object.
    """
    snapshot = load_policy(checkpoint)
    network = actor_config(snapshot.architecture)
    parsed = parse(program, network.vocabulary)
    phi = TorchActor(network, snapshot.tensors, MIN_MAX).properties(
        observation.objects, network.world.arm(observation)
    )
    p = relevance(parsed, phi.tolist(), network.vocabulary.row, observation.hand_index, MIN_MAX)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10, 4), layout="constrained", width_ratios=(1, 1.6)
    )
    hand, *places = task.simulation.positions[:, :2].tolist()
    kinds = [block.kind for block in task.episode.blocks]
    blocks = [(kind, x, y) for kind, (x, y) in zip(kinds, places, strict=True)]
    _top_view(left, blocks, (hand[0], hand[1]))
    heat_map(right, kinds, phi, np.array(p), network.vocabulary.words)
    right.set_title("learned detectors Φᵀ and relevant objects p")
    figure.suptitle(str(parsed), family="monospace", fontsize=10)
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


def _top_view(
    axes: Axes, blocks: Sequence[tuple[Kind, float, float]], hand: tuple[float, float]
) -> None:
    """Draw blocks, hand and base as seen from above, in metres."""
    reach = max([0.75, *(max(abs(x), abs(y)) + 0.1 for _, x, y in blocks)])
    axes.add_patch(Rectangle((-reach, -reach), 2 * reach, 2 * reach, color="#e6e0d2"))
    axes.plot([0, hand[0]], [0, hand[1]], color="#888888", linewidth=5, solid_capstyle="round")
    axes.add_patch(Circle((0, 0), 0.05, color="#444444"))
    axes.plot(*hand, marker="o", markersize=15, color="white", markeredgecolor="black")
    for kind, x, y in blocks:
        look = look_of(kind)
        axes.plot(x, y, look.marker, markersize=12 * look.scale, color=look.rgb,
                  markeredgecolor="black")  # fmt: skip
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x (m)",
             ylabel="y (m)", title="the arena from above")  # fmt: skip


def save(figure: Figure, path: Path, colors: int | None = None) -> None:
    """Write a PNG and close the figure; a palette of `colors` makes the file small."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    if colors is not None:
        with Image.open(path) as picture:
            small = picture.convert("RGB").quantize(
                colors, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
            )
        small.save(path, optimize=True)
