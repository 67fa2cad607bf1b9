"""How episodes end in which programs move objects, by condition and seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np

from pa_ros.arena import conditions_for
from pa_ros.evaluation.agents import TrainedAgent
from pa_ros.evaluation.scorer import Benchmark, Scorer
from pa_ros.evaluation.scores import EpisodeScore
from pa_ros.language import Expression, Not, Vocabulary, Word, parse
from pa_ros.language.syntax import walk

CLOSE_M = 0.07  # objects closer than this are counted, too
FEW = ("train", "eval", "pairs", "reach")  # conditions of variants


@dataclass(frozen=True, slots=True)
class EndsRow:
    """The episodes of one seed and condition, apart by whether their programs name a sphere."""

    seed: int
    condition: str
    spheres: bool  # they roll on
    episodes: int
    success: float  # share that is satisfied at the end
    ever: float  # at some step
    close: float  # objects at most CLOSE_M apart at the end; NaN where the hand is moved
    normalized: float  # reward, 0 random, 1 the script, where the hand is moved; else NaN


def ends(
    scores: Sequence[EpisodeScore],
    vocabulary: Vocabulary,
    seed: int = 0,
    condition: str = "",
    score: float = nan,
) -> list[EndsRow]:
    """How episodes ended: without spheres, with spheres; only what there is."""
    rows = []
    for spheres in (False, True):
        own = [one for one in scores if _names_a_sphere(one, vocabulary) == spheres]
        if own:
            pushes = any(not parse(one.program, vocabulary).moves_hand for one in own)
            columns = [(one.success, one.ever, one.distance <= CLOSE_M) for one in own]
            success, ever, close = np.mean(columns, axis=0).tolist()
            close = close if pushes else nan
            rows.append(EndsRow(seed, condition, spheres, len(own), success, ever, close, score))
    return rows


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


def _names_a_sphere(score: EpisodeScore, vocabulary: Vocabulary) -> bool:
    """Whether the program names a sphere: not one that it excludes."""
    program = parse(score.program, vocabulary)
    parts: list[Expression] = [*walk(program.moved), *walk(program.target)]
    excluded = {part for one in parts if isinstance(one, Not) for part in walk(one)}
    return Word("SPHERE") in {*parts} - excluded
