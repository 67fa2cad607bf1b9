"""All-goals relabeling: one stored transition, scored under several training programs.

Not in the paper. A transition does not depend on the program that was being executed, only its
reward does, and the verifier can say what that would have been under another program. Done once
per trajectory, as bits, so that drawing programs for a batch is a gather.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.language import Program
from pa_ros.learning.errors import LearningError
from pa_ros.learning.replay_buffer.buffer import Column, Int64, ReplayBuffer
from pa_ros.learning.rules.rule import Drawn, Int32, Rule
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.measures import ProgramMeasures
from pa_ros.world.world import World

MAX_PROGRAMS = 64  # bits of a mask
AVOIDING = 0.5  # share of drawn programs that avoid a set, where networks learn to
# Share of transitions that keep the avoiding program under which they were collected. There the set
# to avoid is close to the target, which is hard to learn and rare in drawn programs.
KEPT = 0.3
# Value of a violated program, as a share of that of never being rewarded. At 1 agents keep so far
# away from what they avoid that they don't reach targets beside it.
VIOLATED = 0.5

UInt64 = NDArray[np.uint64]


class Masks(NamedTuple):
    """What is stored of each row [...]. Bit j of a mask is training program j; column j of
    `goal_reward` is program j of all programs."""

    satisfied: UInt64  # [...] bits
    present: Any  # bits of the training programs that name an object: of a trajectory, or [...]
    goal_reward: Float32 | None = None  # [..., P]; None where `satisfied` determines rewards
    may_name: UInt64 | None = None  # [N] bits of the programs that may name an object; None: told


def published(measures: Float64 | None, rows: int, programs: int) -> Float64:
    """The verifier's measures, if they are [rows, training programs]; else LearningError
    (learning.unjudged)."""
    if measures is None or measures.shape != (rows, programs):
        raise LearningError(
            f"trajectory: expected the verifier's measures of the {programs} training programs, "
            "since what is seen tells no words, got "
            f"{'none' if measures is None else f'shape {measures.shape}'}",
            code="learning.unjudged",
        )
    return measures


class AllGoals(Rule):
    """Draws programs at random. The training programs come first, bit j of every mask. Where
    networks learn to avoid, each of them follows once more for each training target, which it
    avoids."""

    def __init__(
        self,
        programs: Sequence[Program],
        world: World,
        scoring: Scoring,
        discount: float = 0.0,
        count: int = 1,
    ) -> None:
        """`count`: K programs for each transition."""
        super().__init__(discount)
        if not 1 <= len(programs) <= MAX_PROGRAMS:
            raise ConfigError(
                f"relabeling: expected 1 to {MAX_PROGRAMS} programs, got {len(programs)}"
            )
        avoids = world.vocabulary.avoids
        if avoids and scoring.reward.uses_measure:
            raise ConfigError(
                "relabeling: expected a reward of `satisfied` alone where programs avoid, got "
                f"{scoring.reward.to_json()}"
            )
        self._measures, self._world = ProgramMeasures(programs, world, scoring), world
        self._scoring, self._count = scoring, count
        self.programs = (*programs,)
        self._avoiding = len(programs) if avoids else 0
        if self._avoiding:
            self.programs += tuple(
                replace(one, avoided=other.target) for one in programs for other in programs
            )
        self.draws_several = not self._avoiding
        self._bits = np.uint64(1) << np.arange(len(programs), dtype=np.uint64)
        self._values: Float64 | None = None  # of a program not satisfied, and of one that is
        if not scoring.reward.uses_measure:
            self._values = scoring.reward(np.array([False, True]), np.array([inf, 0.0]))
        self.columns = {"satisfied": Column(np.uint64), "present": Column(np.uint64)}
        if self._values is None:
            self.columns["goal_reward"] = Column(np.float32, (len(self.programs),))
        if not world.schema.tells_words:
            self.columns["may_name"] = Column(np.uint64, of_objects=True)

    def describe(self, trajectory: Trajectory) -> dict[str, Any]:
        masks = self.masks(
            trajectory.objects,
            trajectory.hand_index,
            self._world.hand_pose(trajectory.arm),
            trajectory.measures,
        )
        return {name: value for name, value in masks._asdict().items() if value is not None}

    def masks(
        self,
        objects: Float32,
        hand_index: int,
        hand_pose: Float32 | None = None,
        measures: Float64 | None = None,
    ) -> Masks:
        """Which programs each row satisfies, [T + 1], which name something, and the rewards.

        `objects` is [T + 1, N, F] of one episode, where properties do not change; `hand_pose`
        [T + 1, 7] is the hand's in the base's frame, where a relation asks for it. Where features
        tell no words, the verifier's `measures` [T + 1, training programs] say all that; raises
        LearningError (learning.unjudged) without them.
        """
        may_name = None
        present: NDArray[np.bool_]
        if "may_name" not in self.columns:
            named = self._measures.named(objects[0], hand_index)  # [P, N]
            measures = self._measures(named, objects, hand_pose)  # [T + 1, P]
            present = np.asarray(named.any(-1))
        else:
            measures = published(measures, len(objects), len(self._measures))
            present = np.asarray(np.isfinite(measures[0]))
            may = self._measures.may_be_named(measures, objects, hand_pose)
            other = ~self._bits.sum()  # programs of which nothing is known
            may_name = self._bits_of(may.T) | other  # [N]
        satisfied: NDArray[np.bool_] = np.asarray(measures <= self._measures.thresholds)
        rewards = None
        if self._values is None:
            earned = self._scoring.reward(satisfied, measures)
            rewards = np.where(present, earned, 0.0).astype(np.float32)
        return Masks(self._bits_of(satisfied), int(self._bits_of(present)), rewards, may_name)

    def _bits_of(self, flags: NDArray[np.bool_]) -> UInt64:
        """[..., training programs] as bits, [...]."""
        bits: UInt64 = flags @ self._bits
        return bits

    def draw(self, rng: np.random.Generator, replay: ReplayBuffer, size: int) -> Drawn:
        index = replay.sample(rng, size)
        acted, reward = replay.arrays["program"][index], replay.arrays["reward"][index]
        masks = self._stored(replay, index)
        program, rewards = self.choose(rng, acted, reward, masks, self._count)
        discount = self.discounts(replay, index)
        if self._avoiding:
            # A violated program cannot hold any more, so nothing is bootstrapped.
            lost = self._violated(program, masks)
            discount[lost[:, 0]] = 0.0
            assert self._values is not None
            never = float(self._values[0]) / (1.0 - self._discount)
            rewards = np.where(lost, np.float32(VIOLATED * never), rewards)
        return Drawn(replay, index, program, rewards, discount)

    def rewards(self, replay: ReplayBuffer, rows: Int64, program: Int32) -> Float32:
        acted = program == replay.arrays["program"][rows, None]
        own = super().rewards(replay, rows, program)
        return np.where(acted, own, self._rewards(program, self._stored(replay, rows)))

    def _stored(self, replay: ReplayBuffer, index: Int64) -> Masks:
        """The masks of transitions, each of which is rewarded for the state that it leads to."""
        arrays, following = replay.arrays, replay.following(index)
        rewards = arrays["goal_reward"][following] if "goal_reward" in arrays else None
        return Masks(arrays["satisfied"][following], arrays["present"][index], rewards)

    def choose(
        self, rng: np.random.Generator, original: Int32, reward: Float32, masks: Masks, k: int
    ) -> tuple[Int32, Float32]:
        """K programs, [B, K], and their rewards, [B, K], for B transitions.

        Given the program that acted and its reward, [B], and the masks of the next rows. Programs
        present are drawn uniformly without replacement, and over again if they are fewer than K.
        """
        present = self._unpack(masks.present)  # [B, P]
        keys = rng.random(present.shape)
        order = np.argsort(np.where(present, keys, 2.0), axis=1)  # those present come first
        count = present.sum(1, keepdims=True)
        # Fewer than K are repeated in turn. Without any, the column is replaced below.
        column = np.arange(k) % np.maximum(count, 1)  # [B, K]
        other = np.take_along_axis(order, column, 1).astype(np.int32)
        if self._avoiding:
            other = self._avoid(rng, other, present)
            acted = (original >= self._avoiding) & (original < len(self.programs))
            kept = acted & (rng.random(len(original)) < KEPT)
            other = np.where(kept[:, None], original[:, None], other)
        rewards = self._rewards(other, masks)
        program = np.where(count > 0, other, original[:, None])
        rewards = np.where(count > 0, rewards, reward[:, None])
        return program, rewards

    def _avoid(self, rng: np.random.Generator, program: Int32, present: NDArray[np.bool_]) -> Int32:
        """Half of the programs [B, K], each with another target that is present, to be avoided."""
        count = len(self._measures)
        may = present[:, None] & (program[..., None] != np.arange(count))  # [B, K, P]
        keys = np.where(may, rng.random(may.shape), 0.0)
        chosen = (rng.random(program.shape) < AVOIDING) & may.any(-1)
        pair = self._avoiding + program * count + keys.argmax(-1)
        return np.where(chosen, pair, program).astype(np.int32)

    def _violated(self, program: Int32, masks: Masks) -> NDArray[np.bool_]:
        """Whether programs [B, K] are violated, [B, K], given the masks of the next rows."""
        avoids = (program >= self._avoiding) & (program < len(self.programs))
        bit = (program - self._avoiding) % len(self._measures)
        near = masks.satisfied[:, None] >> np.where(avoids, bit, 0).astype(np.uint64) & np.uint64(1)
        return np.asarray(avoids & (near != 0))

    def _rewards(self, program: Int32, masks: Masks) -> Float32:
        """Rewards [B, K] of programs [B, K] without what they avoid, given the masks of the next
        rows."""
        if self._avoiding:
            relation = (program - self._avoiding) // len(self._measures)
            program = np.where(program < self._avoiding, program, relation)
        if self._values is None:
            assert masks.goal_reward is not None
            return np.asarray(np.take_along_axis(masks.goal_reward, program, 1))
        no, yes = self._values
        satisfying = np.take_along_axis(self._unpack(masks.satisfied), program, 1)
        return np.asarray(np.where(satisfying, yes, no), np.float32)

    def _unpack(self, bits: UInt64) -> NDArray[np.bool_]:
        return np.asarray(bits[:, None] & self._bits != 0)
