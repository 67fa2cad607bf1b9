"""Is a program satisfied, by how much, and what does that earn? The only place that says so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.language.syntax import NEAR
from pa_ros.world.relations import RELATIONS
from pa_ros.world.relations.frames import POSE
from pa_ros.world.reward import Reward, Sparse


class Score(NamedTuple):
    """The verifier's word on states, each [...], or on one, as numbers."""

    measure: Any  # the relation's, in its unit: the least over the objects named; inf if none is
    satisfied: Any
    reward: Any


def _paper() -> dict[str, float]:
    return {NEAR: RELATIONS[NEAR].threshold}


@dataclass(frozen=True)
class Scoring:
    """One arena's rule: a relation holds where its measure is at most the arena's threshold.

    ConfigError for a relation that is not registered, and for a threshold that cannot be.
    """

    thresholds: Mapping[str, float] = field(default_factory=_paper, hash=False)
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
        """With thresholds of these relations in their order, or, where none is given, their own."""
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
    ) -> Score:
        """Score states [..., N, F] under programs of which it is known what they name, [..., N].

        Both are broadcast: `named` [P, N] and `objects` [T, 1, N, F] give scores [T, P]. The hand
        is never named (`world.programs.crisp`, `language.satisfying`). `hand_pose`, in the base's
        frame, is [..., 7], [T, 1, 7] say; relations in the hand's own frame do without.
        """
        threshold = self.threshold(relation)
        measures = self._measures(relation, objects, hand_pose)
        nearest: Float64 = np.array(inf)
        for i in range(objects.shape[-2]):  # few: faster than to reduce a short axis
            nearest = np.minimum(nearest, np.where(named[..., i], measures[..., i], inf))
        return self._judge(nearest, threshold)

    def of_targets(
        self,
        targets: Sequence[int],
        objects: Float32,
        relation: str = NEAR,
        hand_pose: Float64 | Float32 | None = None,
    ) -> Score:
        """Score one state, [N, F], given the numbers of the objects named: the same bits, sooner,
        as numbers."""
        threshold = self.threshold(relation)
        measures = self._measures(relation, objects, hand_pose).tolist()
        return self._judge(min([measures[i] for i in targets], default=inf), threshold)

    def threshold(self, relation: str) -> float:
        """ConfigError, with the known ones, for a relation that is not scored here."""
        if relation not in self.thresholds:
            raise ConfigError(
                f"unknown relation: expected one of {list(self.thresholds)}, got {relation!r}"
            )
        return self.thresholds[relation]

    def _measures(
        self, relation: str, objects: Float32, hand_pose: Float64 | Float32 | None
    ) -> Float64:
        """Of each object, [..., N]."""
        poses, meant, hand = objects[..., :POSE].astype(np.float64), RELATIONS[relation], None
        if meant.frame == "base" and hand_pose is not None:
            # agents are told float32, and relabeling has no more than that
            hand = hand_pose.astype(np.float32).astype(np.float64)[..., None, :]
        return meant.measures(poses, hand)

    def _judge(self, measure: Any, threshold: float) -> Score:
        satisfied = measure <= threshold
        return Score(measure, satisfied, self.reward(satisfied, measure))
