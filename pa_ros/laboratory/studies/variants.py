"""Compare an experiment with its variants: what each ingredient of a recipe contributes."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from laboratory.studies.experiments import SeedSummary, seeds_table, summarize
from laboratory.studies.tables import EvaluationError, read_curves, read_rows, read_setting
from pa_ros.arena.skills import NORMALIZED
from pa_ros.evaluation.scores import mean_interval
from pa_ros.learning.recipes import DPG

NO_VARIANTS = "evaluation.no_variants"
_SAME = ("arm", "preset", "recipe", "algorithm")  # in all tables that are compared


@dataclass(frozen=True, slots=True)
class Variant:
    """One setting, judged by its curves up to `frames`. Scores are as in SeedSummary."""

    label: str
    changed: str  # options of the recipe (empty for the recipe itself), or the algorithm
    seeds: int
    frames: float
    solved: int  # seeds whose held-out score is at least SOLVED at `frames`
    frames_to_solve: float  # median over seeds, the unsolved counted as infinite
    wall_s_to_solve: float  # median over seeds, the unsolved counted as infinite
    held_out: float  # mean over seeds, at `frames`
    low: float  # 95 % bootstrap interval over seeds
    high: float


def compare(
    name: str, results: Path, by: str = "options"
) -> tuple[list[Variant], dict[str, list[SeedSummary]]]:
    """Compare the table `name` in `results` with those that differ from it in `by` only.

    All are cut to the frames of the shortest curve. `name` is an experiment's label, such as
    `programmable-3D.paper-arm`; `by` is "options" (of the recipe) or "algorithm". Returns a row
    for each table, and each one's seeds. Raises EvaluationError with the code NO_VARIANTS if there
    is nothing to compare, with another code for damaged files.
    """
    tables = sorted(
        table
        for table in results.glob(f"{name}*.csv")
        if f"{table.stem}.".startswith(f"{name}.") and table.with_suffix(".json").exists()
    )
    settings = {
        table: {"arm": "jaco", "algorithm": DPG, "score": NORMALIZED}
        | read_setting(table, "preset", "recipe", "options")
        for table in tables
    }
    own = settings.get(results / f"{name}.csv", {})
    chosen = [
        table
        for table, setting in settings.items()
        if all(setting[key] == own.get(key) for key in _SAME if key != by)
        and (by == "options" or setting["options"] == own.get("options"))
    ]
    if len(chosen) < 2:
        raise EvaluationError(
            f"variants: expected {name} and a variant of it in {results}", code=NO_VARIANTS
        )
    curves = {table: read_curves(table) for table in chosen}
    frames = min(min(rows[-1]["frames"] for rows in seeds.values()) for seeds in curves.values())
    rows, seeds_of = [], {}
    for table in chosen:
        final = {row.seed: row for row in read_rows(seeds_table(table), SeedSummary)}
        score = settings[table]["score"]
        seeds = [_until(frames, curve, final[seed], score) for seed, curve in curves[table].items()]
        seeds_of[table.stem] = seeds
        changed = settings[table][by]
        if not isinstance(changed, str):
            changed = " ".join(
                f"{name}={value if isinstance(value, str) else json.dumps(value)}"
                for name, value in changed.items()
            )
        rows.append(_variant(table.stem, changed, seeds, frames))
    return rows, seeds_of


def _until(
    frames: float, curve: list[dict[str, float]], final: SeedSummary, score: str
) -> SeedSummary:
    """A seed after so many frames; judged on fresh episodes if it ended there."""
    seen = [row for row in curve if row["frames"] <= frames]
    if len(seen) < len(curve):
        return summarize(final.seed, seen, score=score)
    return summarize(final.seed, seen, (final.final_held_out, final.final_train), score)


def _variant(label: str, changed: str, seeds: Sequence[SeedSummary], frames: float) -> Variant:
    interval = mean_interval(np.array([seed.held_out_at_end for seed in seeds]))
    return Variant(
        label,
        changed,
        len(seeds),
        frames,
        sum(seed.solved for seed in seeds),
        _median([seed.frames_to_solve for seed in seeds]),
        _median([seed.wall_s_to_solve for seed in seeds]),
        interval.mean,
        interval.low,
        interval.high,
    )


def _median(values: Sequence[float]) -> float:
    return float(np.median([math.inf if math.isnan(value) else value for value in values]))
