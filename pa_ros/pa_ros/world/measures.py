"""How far every training program is from holding, for relabeling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32, Float64
from pa_ros.language import Program
from pa_ros.world.programs import ProgramTable, crisp, crisp_sets
from pa_ros.world.scoring import Scoring
from pa_ros.world.world import World

SAME = 0.15  # of a threshold: measures that differ by less may be of the same object


class ProgramMeasures:
    """The P training programs of a world, in order.

    The measure of a program is the verifier's (`Scoring`): the least among the objects that it
    names, or pairs of them, infinite if it names none. It holds if that is at most its threshold.
    """

    def __init__(self, programs: Sequence[Program], world: World, scoring: Scoring) -> None:
        self._table = ProgramTable(world.vocabulary, programs)
        self._world, self._scoring = world, scoring
        compiled, hand = self._table.compiled(), len(world.vocabulary.words)
        pushes = compiled.moved != hand  # the register of HAND
        self._of_relation, self._pushing = (
            {
                relation: rows
                for relation, row in world.vocabulary.relation_row.items()
                if len(rows := np.flatnonzero((compiled.relation == row) & of))
            }
            for of in (~pushes, pushes)
        )
        self.thresholds = np.array([scoring.threshold(p.relation) for p in self._table.programs])

    def __len__(self) -> int:
        return len(self._table)

    def named(self, objects: Float32, hand_index: int) -> NDArray[np.bool_]:
        """Which objects [N, F] each program names, [P, N], or where some programs move objects,
        which its two sets contain, [P, 2, N]; ConfigError if nothing tells it."""
        truth = self._world.truth(objects).T
        if self._pushing:
            sets = crisp_sets(self._table.compiled(), truth, hand_index)
            return np.stack([sets.moved, sets.target], 1)
        return crisp(self._table.compiled(), truth, hand_index)

    def __call__(
        self, named: NDArray[np.bool_], objects: Float32, hand_pose: Float64 | Float32 | None
    ) -> Float64:
        """Measures [..., P] of states [..., N, F], given what `named` says of each program."""
        measures = np.zeros((*objects.shape[:-2], len(named)))
        pose = None if hand_pose is None else hand_pose[..., None, :]
        scenes, targets = objects[..., None, :, :], named[:, 1] if self._pushing else named
        for relation, rows in self._of_relation.items():
            score = self._scoring(targets[rows], scenes, relation, pose)
            measures[..., rows] = score.measure
        for relation, rows in self._pushing.items():
            score = self._scoring(targets[rows], scenes, relation, pose, named[rows, 0])
            measures[..., rows] = score.measure
        return measures

    def may_be_named(
        self, measures: Float64, objects: Float32, hand_pose: Float32 | None
    ) -> NDArray[np.bool_]:
        """Which objects [T, N, F] each program may name, [P, N], given its measures [T, P] only.

        That is where an object's own measure mostly is the program's.
        """
        may = np.zeros((len(self), objects.shape[1]), np.bool_)
        for relation, rows in self._of_relation.items():
            own = self._scoring.measures(relation, objects, hand_pose)  # [T, N]
            with np.errstate(invalid="ignore"):  # inf - inf
                apart = np.median(np.abs(own[:, None] - measures[:, rows, None]), axis=0)
            may[rows] = apart < SAME * self.thresholds[rows, None]
        return may
