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
from pa_ros.evaluation.scores import EpisodeScore, normalized, rewards
from pa_ros.language import Expression, Not, Vocabulary, Word, parse
from pa_ros.language.syntax import walk

CLOSE_M = 0.07  # objects closer than this are counted, too
FEW = ("train", "eval", "pairs", "reach")  # conditions of variants


@dataclass(frozen=True, slots=True)
class Ends:
    """How some episodes ended, as shares."""

    success: float  # satisfied at the end
    ever: float  # satisfied at some step
    close: float  # objects at most CLOSE_M apart at the end; NaN where the hand is moved


@dataclass(frozen=True, slots=True)
class EndsRow:
    """The episodes of one seed and condition, apart by whether their programs name a sphere."""

    seed: int
    condition: str
    spheres: bool  # they roll on
    episodes: int
    success: float  # as in Ends
    ever: float
    close: float
    normalized: float  # reward, 0 random, 1 the script, where the hand is moved; else NaN


def ends(scores: Sequence[EpisodeScore], vocabulary: Vocabulary) -> dict[bool, Ends]:
    """How episodes ended, by whether their programs name a sphere; only kinds that there are."""
    return {named: _ends(own, vocabulary) for named, own in _kinds(scores, vocabulary).items()}


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
    vocabulary, rows = first.design.vocabulary, list[EndsRow]()
    for condition in conditions or conditions_for(first.design):
        for seed, agent in agents.items():
            scores = scorer.agent(agent, condition)
            score = _normalized(scorer, condition, scores) if "reach" in condition else nan
            for named, own in _kinds(scores, vocabulary).items():
                found = _ends(own, vocabulary)
                rows.append(EndsRow(seed, condition, named, len(own), found.success, found.ever,
                                    found.close, score))  # fmt: skip
        mine = [row.success for row in rows if row.condition == condition and not row.spheres]
        report(f"{condition:18s} {np.median(mine) if mine else nan:.2f} succeed (median)")
    return rows


def _normalized(scorer: Scorer, condition: str, scores: Sequence[EpisodeScore]) -> float:
    low, high = (
        rewards(scorer.reference(name, condition)).mean() for name in ("random", "scripted")
    )
    return normalized(float(rewards(scores).mean()), float(low), float(high))


def _kinds(
    scores: Sequence[EpisodeScore], vocabulary: Vocabulary
) -> dict[bool, list[EpisodeScore]]:
    """Scores by whether the program names a sphere: not those that it excludes."""
    kinds: dict[bool, list[EpisodeScore]] = {}
    for score in scores:
        program = parse(score.program, vocabulary)
        parts: list[Expression] = [*walk(program.moved), *walk(program.target)]
        excluded = {part for one in parts if isinstance(one, Not) for part in walk(one)}
        kinds.setdefault(Word("SPHERE") in {*parts} - excluded, []).append(score)
    return kinds


def _ends(scores: Sequence[EpisodeScore], vocabulary: Vocabulary) -> Ends:
    pushes = any(not parse(score.program, vocabulary).moves_hand for score in scores)
    close = float(np.mean([score.distance <= CLOSE_M for score in scores])) if pushes else nan
    success = float(np.mean([score.success for score in scores]))
    return Ends(success, float(np.mean([score.ever for score in scores])), close)
