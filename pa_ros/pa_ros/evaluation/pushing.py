"""How episodes end in which programs move objects, apart by whether they name a sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from pa_ros.evaluation.scores import EpisodeScore
from pa_ros.language import HAND, Expression, Not, Vocabulary, Word, parse
from pa_ros.language.syntax import walk

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
            pushes = any(HAND not in parse(one.program, vocabulary).sets for one in own)
            columns = [(one.success, one.ever, one.distance <= CLOSE_M) for one in own]
            success, ever, close = np.mean(columns, axis=0).tolist()
            close = close if pushes else nan
            rows.append(EndsRow(seed, condition, spheres, len(own), success, ever, close, score))
    return rows


def _names_a_sphere(score: EpisodeScore, vocabulary: Vocabulary) -> bool:
    """Whether the program names a sphere: not one that it excludes."""
    program = parse(score.program, vocabulary)
    parts: list[Expression] = [part for one in program.nouns for part in walk(one)]
    excluded = {part for one in parts if isinstance(one, Not) for part in walk(one)}
    return Word("SPHERE") in {*parts} - excluded
