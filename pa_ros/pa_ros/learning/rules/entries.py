"""Hindsight for programs that move the hand: what the hand came to later, and what it then avoided.

Not in the paper. A stored transition is as valid under the program of another target, to which the
hand came a few steps later: then it was on the way there (Andrychowicz et al. 2017). Which training
programs each state satisfies, the verifier says. Drawn from all steps, fewer than one transition in
a hundred is rewarded, and words are learned inverted; so part of a batch is drawn around entries.

A transition into the target is rewarded with 1 and ends the task, as one to what is avoided does
with nothing: a violation is not worse than never to arrive. Training is stricter than the verifier:
the hand must come nearer, and stay farther away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32
from pa_ros.language import Or, Program
from pa_ros.learning.errors import LearningError
from pa_ros.learning.replay_buffer.buffer import Column, Int64, ReplayBuffer
from pa_ros.learning.rules.all_goals import MAX_PROGRAMS, published
from pa_ros.learning.rules.rule import Drawn, Int32, Rule
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.measures import ProgramMeasures
from pa_ros.world.world import World

Bools = NDArray[np.bool_]
UInt64 = NDArray[np.uint64]

AROUND = 0.6  # share of transitions drawn around entries
BEFORE = 16  # steps before an entry from which they are drawn
# Share of these that have another target. Else whatever the hand comes to would be what the program
# means, and words would not matter.
CROSS = 0.4
MARGIN = 1 / 7  # of the threshold: 0.01 m of 0.07 m
AVOIDING = (0.2, 0.5, 0.3)  # shares of drawn programs that avoid none, one, two
SOON, SOON_STEPS = 0.5, 4  # how often what the hand will come to in so many steps is avoided


class Entries(Rule):
    """Draws transitions with one program each: the training programs, and those that avoid an OR of
    two sets that training programs avoid with the same target."""

    def __init__(
        self,
        programs: Sequence[Program],
        world: World,
        scoring: Scoring,
        discount: float = 0.0,
    ) -> None:
        """ConfigError for too many targets, or programs that avoid a set but not its program."""
        super().__init__(discount)
        reaching = [one for one in programs if one.avoided is None]
        if not 1 <= len(reaching) <= MAX_PROGRAMS:
            raise ConfigError(
                f"relabeling: expected 1 to {MAX_PROGRAMS} programs that avoid nothing, got "
                f"{len(reaching)}"
            )
        row = {one: i for i, one in enumerate(reaching)}
        self._measures, self._world = ProgramMeasures(reaching, world, scoring), world
        self._thresholds = self._measures.thresholds
        self._bits = np.uint64(1) << np.arange(len(reaching), dtype=np.uint64)
        every: dict[tuple[int, tuple[int, ...]], Program]  # by target and what is avoided
        every = {(i, ()): one for one, i in row.items()}
        for one in programs if world.vocabulary.avoids else reaching:
            if one.avoided is not None:
                pair = one.relation_alone, replace(one, target=one.avoided, avoided=None)
                every[row[pair[0]], (row[pair[1]],)] = one
        if world.vocabulary.avoids and len(every) == len(reaching):
            every |= {
                (i, (j,)): replace(one, avoided=other.target)
                for one, i in row.items() for other, j in row.items() if i != j
            }  # fmt: skip
        self._may = np.zeros((len(reaching), len(reaching)), np.bool_)  # [target, avoided]
        for i, j in [(i, *out) for i, out in every if out]:
            self._may[i, j] = True
        every |= {
            (i, two): replace(one, avoided=Or(tuple(reaching[j].target for j in two)))
            for one, i in row.items()
            for two in combinations(np.flatnonzero(self._may[i]).tolist(), 2)
        }
        self.programs = (*every.values(),)
        self._target = np.array([i for i, _ in every])
        self._avoided = np.array([sum(int(self._bits[j]) for j in out) for _, out in every],
                                 np.uint64)  # fmt: skip
        # Rows by target and up to two avoided programs, -1 for none: the last index.
        self._row = np.zeros((len(reaching), len(reaching) + 1, len(reaching) + 1), np.int32)
        for number, (i, out) in enumerate(every):
            j, k, *_ = (*out, -1, -1)
            self._row[i, j, k] = self._row[i, k, j] = number
        self.columns = {
            "inside": Column(np.uint64),  # bit j: reaching program j holds, by the margin
            "close": Column(np.uint64),  # it holds, or nearly
            "soon": Column(np.uint64),  # it will be close within SOON_STEPS
            "entered": Column(np.uint64),  # it holds in the next row, and not in this one
            "present": Column(np.uint64),
            "step": Column(np.int32),  # of the trajectory, whose number is `trajectory`
            "trajectory": Column(np.int64),
        }
        if not world.schema.tells_words:
            self.columns["may_name"] = Column(np.uint64, of_objects=True)

    def describe(self, trajectory: Trajectory) -> dict[str, Any]:
        pose, described = self._world.hand_pose(trajectory.arm), dict[str, Any]()
        if "may_name" in self.columns:
            measures = published(trajectory.measures, len(trajectory) + 1, len(self._measures))
            may = self._measures.may_be_named(measures, trajectory.objects, pose)
            described["may_name"] = may.T @ self._bits
        else:
            named = self._measures.named(trajectory.objects[0], trajectory.hand_index)
            measures = self._measures(named, trajectory.objects, pose)
        inside = measures <= self._thresholds * (1 - MARGIN)  # [T + 1, P]
        close = measures <= self._thresholds * (1 + MARGIN)
        entered, soon = np.zeros_like(inside), np.zeros_like(close)
        entered[:-1] = inside[1:] & ~inside[:-1]
        for later in range(1, SOON_STEPS + 1):
            soon[:-later] |= close[later:]
        bits = {"inside": inside, "close": close, "soon": soon, "entered": entered}
        return {
            **described,
            **{name: flags @ self._bits for name, flags in bits.items()},
            "present": np.isfinite(measures[0]) @ self._bits,
            "step": np.arange(len(measures)),
            "trajectory": trajectory.key.sequence,
        }

    def draw(self, rng: np.random.Generator, replay: ReplayBuffer, size: int) -> Drawn:
        index, arrays = replay.sample(rng, size), replay.arrays
        program = arrays["program"][index]
        at, row, target = self._entries(rng, replay, size)
        index[at] = row
        program[at] = self._programs(rng, target, arrays, row)
        # Of another program than ours, under which somebody acted, only the verdict is known.
        ours = program < len(self.programs)
        known = np.where(ours, program, 0)
        following = replay.following(index)
        done = arrays["inside"][following] & self._bits[self._target[known]] != 0
        done = np.where(ours, done, arrays["reward"][index] > 0)
        lost = ours & (arrays["close"][following] & self._avoided[known] != 0)
        reward = (done & ~lost).astype(np.float32)
        discount = self.discounts(replay, index)
        discount[done | lost] = 0.0
        return Drawn(replay, index, program[:, None], reward[:, None], discount)

    def rewards(self, replay: ReplayBuffer, rows: Int64, program: Int32) -> Float32:
        """Raises LearningError: a reward ends the task here, so it says nothing by itself."""
        raise LearningError("rewards: expected a rule under which the task does not end")

    def _entries(
        self, rng: np.random.Generator, replay: ReplayBuffer, size: int
    ) -> tuple[Int64, Int64, Int64]:
        """Which of so many draws are around entries, [M]; their rows, and the targets."""
        arrays = replay.arrays
        events = np.flatnonzero(replay.filled()["entered"])
        at = np.flatnonzero(rng.random(size) < AROUND)
        if not len(events):
            return at[:0], at[:0], at[:0]
        when = events[rng.integers(len(events), size=len(at))]
        entered = self._flags(arrays["entered"][when])
        target = (entered * rng.random(entered.shape)).argmax(-1)
        back = rng.integers(BEFORE, size=len(at))
        row = (when - back) % replay.capacity
        # Rows before may be of another trajectory, and it may have been there already.
        same = arrays["trajectory"][row] == arrays["trajectory"][when]
        same &= arrays["step"][row] == arrays["step"][when] - back
        others = self._flags(arrays["present"][row] & ~self._bits[target])
        other = (others * rng.random(others.shape)).argmax(-1)
        cross = (rng.random(len(at)) < CROSS) & others.any(-1)
        target = np.where(cross, other, target)
        good = same & (arrays["inside"][row] & self._bits[target] == 0)
        return at[good], row[good], target[good]

    def _programs(
        self, rng: np.random.Generator, target: Int64, arrays: dict[str, Any], row: Int64
    ) -> Int32:
        """Programs for targets [M] that avoid up to two sets, of those that the hand is not close
        to."""
        may = self._may[target] & self._flags(arrays["present"][row] & ~arrays["close"][row])
        early = rng.random((len(row), 1)) < SOON
        score = rng.random(may.shape) + (early & self._flags(arrays["soon"][row]))
        score = np.where(may, score, -1.0)
        chosen, every = np.full((2, len(row)), -1), np.arange(len(row))
        number = rng.choice(3, len(row), p=AVOIDING)
        for k in range(2):
            best = score.argmax(-1)
            chosen[k] = np.where((number > k) & (score[every, best] >= 0), best, -1)
            score[every, best] = -1.0
        return np.asarray(self._row[target, chosen[0], chosen[1]])

    def _flags(self, bits: UInt64) -> Bools:
        return np.asarray(bits[:, None] & self._bits != 0)
