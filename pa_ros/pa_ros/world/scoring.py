"""The scoring rule: is a program satisfied, by how much, and what is the reward?

Verifier and relabeling both use it, so that they give the same bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.language.syntax import NEAR, Program
from pa_ros.world.poses import POSE_WIDTH
from pa_ros.world.relation import RELATIONS
from pa_ros.world.reward import Reward, Sparse

# Where programs move objects, the reward counts a relation only within this part of its threshold.
# An agent learns where the reward begins to within about a centimetre, and would stop outside.
REWARDED = 0.7


class Score(NamedTuple):
    """The verifier's answer for states, each [...], or for one state, as numbers."""

    measure: Any  # of the relation, in its unit: the least over the named pairs; inf if none
    satisfied: Any
    reward: Any


@dataclass(frozen=True)
class Scoring:
    """The rule of one arena: a relation holds where its measure is at most the arena's threshold.

    ConfigError for an unknown relation, and for a threshold that is not positive.
    """

    thresholds: Mapping[str, float] = field(
        default_factory=lambda: {NEAR: RELATIONS[NEAR].threshold}, hash=False
    )
    reward: Reward = field(default_factory=Sparse)

    def __post_init__(self) -> None:
        for relation, threshold in self.thresholds.items():
            RELATIONS[relation].check(threshold)

    @classmethod
    def of(
        cls,
        relations: Iterable[str],
        thresholds: Sequence[float] = (),
        reward: Reward | None = None,
    ) -> Scoring:
        """Scoring with a threshold for each relation, in order; by default the relations' own."""
        names = tuple(relations)
        if thresholds and len(thresholds) != len(names):
            raise ConfigError(
                f"thresholds: expected none, or one for each of {names}, got {tuple(thresholds)}"
            )
        own = thresholds or [RELATIONS[name].threshold for name in names]
        return cls(dict(zip(names, own, strict=True)), reward or Sparse())

    def __call__(
        self,
        named: NDArray[np.bool_],
        objects: Float32,
        relation: str = NEAR,
        hand_pose: Float64 | Float32 | None = None,
        moved: NDArray[np.bool_] | None = None,
    ) -> Score:
        """Score states [..., N, F] under programs that name the objects `named` [..., N].

        Both are broadcast: `named` [P, N] and `objects` [T, 1, N, F] give scores [T, P].
        `hand_pose` [..., 7] is in the base's frame; relations in the frame of the hand do not need
        it. `moved` [..., N] are the objects that the programs move; None: the hand, which must not
        be named (see `world.programs.crisp`). The relation holds between some moved object and
        another named one.
        """
        if moved is not None:
            pair = self._nearest(moved, named, relation, objects, hand_pose)
            return self.of_measure(pair, relation, between=True)
        measures = self.measures(relation, objects, hand_pose)
        # An object that is not named counts as infinitely far, so a program that names none is not
        # satisfied.
        nearest: Float64 = np.array(inf)
        for i in range(objects.shape[-2]):  # faster than reducing a short axis
            nearest = np.minimum(nearest, np.where(named[..., i], measures[..., i], inf))
        return self.of_measure(nearest, relation)

    def of_targets(
        self,
        targets: Sequence[int],
        objects: Float32,
        relation: str = NEAR,
        hand_pose: Float64 | Float32 | None = None,
        moved: Sequence[int] | None = None,
    ) -> Score:
        """Score one state [N, F], given the indices of the named and the moved objects: the same
        bits as for many states, but faster, and as numbers."""
        if moved is None:
            measures = self.measures(relation, objects, hand_pose).tolist()
            return self.of_measure(min([measures[i] for i in targets], default=inf), relation)
        pairs = [(i, j) for i in moved for j in targets if i != j]
        first, second = objects[[i for i, _ in pairs]], objects[[j for _, j in pairs]]
        measures = self.measures(relation, second, hand_pose, first).tolist()
        return self.of_measure(min(measures, default=inf), relation, between=True)

    def of_program(
        self,
        program: Program,
        sets: Sequence[Sequence[int]],
        objects: Float32,
        hand_pose: Float64 | Float32 | None = None,
    ) -> Score:
        """Score one state [N, F] under a program whose two sets contain these objects."""
        moved, targets = sets
        pair = None if program.moves_hand else moved
        return self.of_targets(targets, objects, program.relation, hand_pose, pair)

    def threshold_of(self, program: Program) -> float:
        """The threshold of a program's relation; see `threshold`."""
        return self.threshold(program.relation, between=not program.moves_hand)

    def threshold(self, relation: str, between: bool = False) -> float:
        """The threshold of a relation of the hand, or `between` two objects; ConfigError lists the
        known relations."""
        if relation not in self.thresholds:
            raise ConfigError(
                f"unknown relation: expected one of {list(self.thresholds)}, got {relation!r}"
            )
        return (RELATIONS[relation].between if between else None) or self.thresholds[relation]

    def _nearest(
        self,
        moved: NDArray[np.bool_],
        named: NDArray[np.bool_],
        relation: str,
        objects: Float32,
        hand_pose: Float64 | Float32 | None,
    ) -> Float64:
        """The least measure over pairs of a moved and another named object, [...]."""
        scored = np.broadcast_shapes(moved.shape, named.shape, objects.shape[:-1])[:-1]
        nearest: Float64 = np.full(scored, inf)
        for i in np.flatnonzero(moved.any(tuple(range(moved.ndim - 1)))):
            measures = self.measures(relation, objects, hand_pose, objects[..., i : i + 1, :])
            for j in range(objects.shape[-2]):
                if i != j:
                    pair = moved[..., i] & named[..., j]
                    nearest = np.minimum(nearest, np.where(pair, measures[..., j], inf))
        return nearest

    def measures(
        self,
        relation: str,
        objects: Float32,
        hand_pose: Float64 | Float32 | None,
        moved: Float32 | None = None,
    ) -> Float64:
        """The measure of each object [..., N, F], [..., N], to the hand or to `moved`.

        `hand_pose` is as for scores, with as many dimensions as one object's features have.
        """
        self.threshold(relation)  # raises an error for an unknown one
        poses, meant, hand = objects[..., :POSE_WIDTH].astype(np.float64), RELATIONS[relation], None
        if meant.frame == "base" and hand_pose is not None:
            # Agents receive float32, and relabeling has no more precision than that.
            hand = hand_pose.astype(np.float32).astype(np.float64)[..., None, :]
        first = None if moved is None else moved[..., :POSE_WIDTH].astype(np.float64)
        return meant.measures(poses, hand, first)

    def of_measure(self, measure: Any, relation: str = NEAR, between: bool = False) -> Score:
        """Score measures [...] of a relation of the hand, or `between` two objects."""
        threshold = self.threshold(relation, between)
        rewarded = REWARDED * threshold if between else threshold
        return Score(measure, measure <= threshold, self.reward(measure <= rewarded, measure))
