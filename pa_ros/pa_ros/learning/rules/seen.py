"""The blocks that programs may mean, where a camera sees blocks and only the verifier knows words.

The verifier publishes how far every training program is from holding, and the words of places are
known. A block may be the red cube of `NEAR(AND(RED, CUBE), AND(BLUE, PLACE))` if it is always as
far from the blue place as the verifier says, in all programs that move the red cube or the hand.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.language import HAND, Program
from pa_ros.learning.rules.all_goals import MAX_PROGRAMS
from pa_ros.world import Scoring
from pa_ros.world.measures import SAME
from pa_ros.world.programs import ProgramTable, crisp_sets
from pa_ros.world.world import World

Bools = NDArray[np.bool_]


class SeenSets:
    """The two sets of each of P training programs, in scenes where only the words of places are
    known."""

    def __init__(self, programs: Sequence[Program], world: World, scoring: Scoring) -> None:
        if len(programs) > MAX_PROGRAMS:
            raise ConfigError(
                f"hindsight: expected at most {MAX_PROGRAMS} training programs where blocks are "
                f"seen, got {len(programs)}"
            )
        self._programs, self._world, self._scoring = programs, world, scoring
        self._table = ProgramTable(world.vocabulary, programs)

    def __call__(
        self, objects: Float32, hand_index: int, hand_pose: Float32, measures: Float64
    ) -> Bools:
        """Which objects [T, N, F] of an episode each program's two sets may contain, [P, 2, N],
        given its measures [T, P]; False for the hand."""
        words, bodies = self._world.told(objects[0]).T, self._world.schema.bodies(objects[0])
        known = crisp_sets(self._table.compiled(), words, hand_index)
        sets = np.stack([known.moved, known.target], 1)
        sets &= ~bodies
        apart: dict[str, Float64] = {}  # by noun: how far each object's measures are from its own
        for program, (_, places), measure in zip(self._programs, sets, measures.T, strict=True):
            noun, of_hand = str(program.nouns[0]), HAND in program.sets
            if of_hand != places.any():  # else both or none are known
                own = self._own(program, places, objects, hand_pose)  # [T, N]
                most = np.median(np.abs(own - measure[:, None]), axis=0)
                most /= self._scoring.threshold_of(program)
                apart[noun] = np.maximum(most, apart.get(noun, 0.0))
        bodies[hand_index] = False
        for program, two in zip(self._programs, sets, strict=True):
            for noun, one in zip(map(str, program.sets), two, strict=True):
                if noun in apart:
                    one |= bodies & (apart[noun] < SAME)
        return sets

    def _own(
        self, program: Program, places: Bools, objects: Float32, hand_pose: Float32
    ) -> Float64:
        """The measure of each object with the hand, or with the nearest of these places, [T, N]."""
        relation = program.relation
        if HAND in program.sets:
            return self._scoring.measures(relation, objects, hand_pose)
        own = [
            self._scoring.measures(relation, objects[:, [place]], hand_pose, objects)
            for place in np.flatnonzero(places)
        ]
        return np.asarray(np.min(own, axis=0))
