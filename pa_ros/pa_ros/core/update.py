"""Input and output of an engine for one update."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32

HAND_INDEX = 0  # of every batch: the replay stores the hand first, whatever its index outside


@dataclass(frozen=True, slots=True)
class Batch:
    """B transitions × K programs. Arrays are C-contiguous; the hand is object 0."""

    objects: Float32  # [B, N, F]
    arm: Float32  # [B, A]
    action: Float32  # [B, J]
    next_objects: Float32  # [B, N, F]
    next_arm: Float32  # [B, A]
    program: NDArray[np.int32]  # [B, K], rows of the ProgramTable
    reward: Float32  # [B, K]
    discount: Float32  # [B]; γ, or 0 after a true termination
    rows: NDArray[np.int64] | None = None  # [B], of the replay buffer, for engines that `attach`


class Engine(Protocol):
    """An algorithm's actor, critics, their targets and optimizers, somewhere.

    The targets start as copies. The table of programs may grow between updates. An engine that
    needs more than s and s' has a method `attach(learner)`, called once: the learner has the replay
    buffer, whose rows `Batch.rows` are, and `rewards` (tests/extending/returns.py).
    """

    name: str

    def update(self, batch: Batch) -> None:
        """One update, all gradients at the parameters before it."""

    def end_episode(self) -> None:
        """An episode has ended: DPG copies both networks to their targets (paper, appendix)."""

    def actor_tensors(self) -> dict[str, Float32]:
        """The actor's weights now, float32 and C-contiguous, owned by the caller."""

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""

    def tensors(self) -> dict[str, NDArray[np.generic]]:
        """Everything an update depends on, owned by the caller.

        Names: `actor.*`, `critic.*` (TD3's are `critic_1`, `critic_2`), `target_actor.*`,
        `target_critic.*`, then for each network `adam.actor.m.*`, `adam.actor.v.*` (first and
        second moments, shaped as the parameters) and `adam.actor.step` (int64 []).
        """

    def load_tensors(self, tensors: dict[str, NDArray[np.generic]]) -> None:
        """The inverse of `tensors`, of an engine with the same networks."""
