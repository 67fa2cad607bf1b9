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
from pa_ros.language.syntax import NEAR
from pa_ros.world.poses import POSE_WIDTH
from pa_ros.world.relation import RELATIONS
from pa_ros.world.reward import Reward, Sparse


class Score(NamedTuple):
    """The verifier's answer for states, each [...], or for one state, as numbers."""

    measure: Any  # of the relation, in its unit: the least over the named objects; inf if none
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
    ) -> Score:
        """Score states [..., N, F] under programs that name the objects `named` [..., N].

        Both are broadcast: `named` [P, N] and `objects` [T, 1, N, F] give scores [T, P]. The hand
        must not be named (see `world.programs.crisp`). `hand_pose` [..., 7] is in the base's frame;
        relations in the frame of the hand do not need it.
        """
        threshold = self.threshold(relation)
        measures = self._measures(relation, objects, hand_pose)
        # An object that is not named counts as infinitely far, so a program that names none is not
        # satisfied.
        nearest: Float64 = np.array(inf)
        for i in range(objects.shape[-2]):  # faster than reducing a short axis
            nearest = np.minimum(nearest, np.where(named[..., i], measures[..., i], inf))
        return self._score(nearest, threshold)

    def of_targets(
        self,
        targets: Sequence[int],
        objects: Float32,
        relation: str = NEAR,
        hand_pose: Float64 | Float32 | None = None,
    ) -> Score:
        """Score one state [N, F], given the indices of the named objects: the same bits as for many
        states, but faster, and as numbers."""
        threshold = self.threshold(relation)
        measures = self._measures(relation, objects, hand_pose).tolist()
        return self._score(min([measures[i] for i in targets], default=inf), threshold)

    def threshold(self, relation: str) -> float:
        """The threshold of a relation; ConfigError lists the known relations."""
        if relation not in self.thresholds:
            raise ConfigError(
                f"unknown relation: expected one of {list(self.thresholds)}, got {relation!r}"
            )
        return self.thresholds[relation]

    def _measures(
        self, relation: str, objects: Float32, hand_pose: Float64 | Float32 | None
    ) -> Float64:
        """The measure of each object, [..., N]."""
        poses, meant, hand = objects[..., :POSE_WIDTH].astype(np.float64), RELATIONS[relation], None
        if meant.frame == "base" and hand_pose is not None:
            # Agents receive float32, and relabeling has no more precision than that.
            hand = hand_pose.astype(np.float32).astype(np.float64)[..., None, :]
        return meant.measures(poses, hand)

    def _score(self, measure: Any, threshold: float) -> Score:
        satisfied = measure <= threshold
        return Score(measure, satisfied, self.reward(satisfied, measure))
