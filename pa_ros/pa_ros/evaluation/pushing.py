"""How episodes end in which programs move objects, apart by whether they name a sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from pa_ros.evaluation.scores import EpisodeScore
from pa_ros.language import HAND, Expression, Not, Program, Vocabulary, Word, parse_goal, stages
from pa_ros.language.syntax import NEAR, walk

CLOSE_M = 0.07  # objects closer than this are counted, too


@dataclass(frozen=True, slots=True)
class EndsRow:
    """The episodes of one seed and condition, apart by whether their programs name a sphere."""

    seed: int
    condition: str
    spheres: bool  # they roll on
    episodes: int
    success: float  # share that is satisfied at the end
    ever: float  # at some step
    close: float  # objects at most CLOSE_M apart at the end; NaN but for NEAR of objects
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
    programs = [stages(parse_goal(one.program, vocabulary)) for one in scores]
    for spheres in (False, True):
        of = [i for i, parts in enumerate(programs) if _name_a_sphere(parts) == spheres]
        if of:
            own = [scores[i] for i in of]
            near = all(p.relation == NEAR and p.moved != HAND for i in of for p in programs[i])
            columns = [(one.success, one.ever, one.distance <= CLOSE_M) for one in own]
            success, ever, close = np.mean(columns, axis=0).tolist()
            close = close if near else nan
            rows.append(EndsRow(seed, condition, spheres, len(own), success, ever, close, score))
    return rows


def _name_a_sphere(programs: Sequence[Program]) -> bool:
    """Whether programs name a sphere: not one that they exclude."""
    parts: list[Expression] = [part for p in programs for one in p.nouns for part in walk(one)]
    excluded = {part for one in parts if isinstance(one, Not) for part in walk(one)}
    return Word("SPHERE") in {*parts} - excluded
