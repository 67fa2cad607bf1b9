"""The picture of an experiment's variants: every seed a dot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, MaxNLocator

from pa_ros.evaluation.pictures.drawing import save
from pa_ros.evaluation.studies.experiments import SOLVED, SeedSummary
from pa_ros.evaluation.studies.variants import Variant

WORDS = {
    "self_weight": "the hand attends to itself: {}",
    "rule": "relabeling: {}",
    "programs_per_transition": "programs for each transition: {}",
    "discount": "discount {}",
    "critic_output_bias": "the critic begins at {}",
    "gain": "detectors' rate × {}",
    "sparsity": "sparse detectors: {}",
    "detectors_have_biases": "detectors with biases: {}",
    "property_dropout": "hidden properties: {}",
    "warmup_frames": "frames before the first update: {}",
    "sigma": "exploration noise σ {}",
    "position_scale": "positions × {}",
    "detector_init_scale": "random detectors at first, × {}",
    "relations_see_properties": "f, r and attention see properties: {}",
}


def in_words(changed: str) -> str:
    """What a variant changed, such as "learner.updates.discount=0.99 …", for a reader."""
    return ", ".join(_in_words(*part.partition("=")[::2]) for part in changed.split())


def _in_words(path: str, value: str) -> str:
    name = path.rpartition(".")[2]
    form = WORDS.get(name, f"{name.replace('_', ' ')} {{}}")
    return form.format({"0": "no", "true": "yes", "false": "no", "none": "no"}.get(value, value))


def variants_figure(
    path: Path, rows: Sequence[Variant], seeds: Mapping[str, Sequence[SeedSummary]]
) -> None:
    """Held-out scores and frames to solve, of each variant's `seeds` (by its label)."""
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
    names = [in_words(row.changed) or "nothing changed" for row in reversed(rows)]
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
