"""How episodes end in which programs move objects: trained agents under every condition."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import nan
from pathlib import Path

import numpy as np

from laboratory.studies.scorer import Benchmark, Scorer
from pa_ros.agents import TrainedAgent
from pa_ros.arena import conditions_for
from pa_ros.evaluation.pushing import EndsRow, ends

FEW = ("train", "eval", "pairs", "reach")  # conditions of variants


def ends_of(
    agents: Mapping[int, TrainedAgent],
    cache: Path,
    episodes: int = 100,
    conditions: Sequence[str] = (),
    report: Callable[[str], None] = print,
) -> list[EndsRow]:
    """Score agents (by seed, of one design and arena) under `conditions` (default: all).

    Scores are stored under `cache`, so that an interrupted call can continue.
    """
    first = next(iter(agents.values()))
    scorer = Scorer(Benchmark(design=first.design, arena=first.arena, episodes=episodes), cache)
    rows: list[EndsRow] = []
    for condition in conditions or conditions_for(first.design):
        for seed, agent in agents.items():
            scores = scorer.agent(agent, condition)
            score = scorer.normalized(condition, scores) if "reach" in condition else nan
            rows += ends(scores, first.design.vocabulary, seed, condition, score)
        mine = [row.success for row in rows if row.condition == condition and not row.spheres]
        report(f"{condition:18s} {np.median(mine) if mine else nan:.2f} succeed (median)")
    return rows
