"""What is done with stored transitions: which columns are kept, and how a batch is drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.core.update import Batch
from pa_ros.language import Program
from pa_ros.learning.replay_buffer.buffer import Column, Int64, ReplayBuffer
from pa_ros.world import Trajectory

Int32 = NDArray[np.int32]
Scenes = tuple[Float32, Float32, Float32, Float32]
"""Objects [B, N, F] and arm [B, A] before transitions, then those after them."""


@dataclass
class Drawn:
    """B drawn transitions, each under K programs."""

    replay: ReplayBuffer
    index: Int64  # [B], rows of the replay buffer
    program: Int32  # [B, K], rows of the learner's table
    reward: Float32  # [B, K]
    discount: Float32  # [B]

    def scenes(self, part: slice) -> Scenes:
        """Objects and arm of some of the transitions, copied."""
        # For so few rows `take` costs half of what indexing costs.
        objects, arm = self.replay.arrays["objects"], self.replay.arrays["arm"]
        index = self.index[part]
        following = self.replay.following(index)
        before = objects.take(index, 0), arm.take(index, 0)
        return *before, objects.take(following, 0), arm.take(following, 0)

    def batch(self, part: slice) -> Batch:
        """Some of the transitions, as an engine takes them."""
        objects, arm, next_objects, next_arm = self.scenes(part)
        return Batch(
            objects=objects,
            arm=arm,
            action=self.replay.arrays["action"].take(self.index[part], 0),
            next_objects=next_objects,
            next_arm=next_arm,
            program=self.program[part],
            reward=self.reward[part],
            discount=self.discount[part],
            rows=self.index[part],
        )


class Rule(ABC):
    """One way to learn from stored transitions."""

    columns: Mapping[str, Column] = {}
    """What the replay buffer keeps for it, by name."""
    programs: tuple[Program, ...] = ()
    """The programs that it draws: program j is row j of the learner's table."""

    draws_several = False
    """Whether it can draw more than one program for a transition."""

    def __init__(self, discount: float) -> None:
        """`discount`: γ per control step."""
        self._discount = discount

    def describe(self, trajectory: Trajectory) -> Mapping[str, Any]:
        """The columns of a trajectory's rows; see `ReplayBuffer.insert`. LearningError for one that
        cannot be learned from."""
        return {}

    @abstractmethod
    def draw(self, rng: np.random.Generator, replay: ReplayBuffer, size: int) -> Drawn:
        """Draw transitions, the programs that they are learned under, and their rewards."""

    def rewards(self, replay: ReplayBuffer, rows: Int64, program: Int32) -> Float32:
        """Rewards [B, K] of stored transitions [B] under programs [B, K] of a batch; here those
        that were stored."""
        return np.repeat(replay.arrays["reward"][rows, None], program.shape[1], 1)

    def discounts(self, replay: ReplayBuffer, index: Int64) -> Float32:
        """The discount of each transition [B]: γ, or 0 where the task ends.

        An episode that its time limit cut off is not terminal: what would have followed still has a
        value.
        """
        terminal = replay.arrays["terminal"][index]
        return np.where(terminal, 0.0, self._discount).astype(np.float32)
