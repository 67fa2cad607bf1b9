"""What an engine is given for one update, and what it answers."""

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


@dataclass(frozen=True, slots=True)
class UpdateValues:
    """All that depends on how many updates were made, for the update that follows them."""

    actor_rate: float
    critic_rate: float
    correction1: float  # what Adam's first moment is divided by, 1 − β₁ᵗ
    correction2: float  # what Adam's second moment is divided by, 1 − β₂ᵗ
    action_l2: float  # weight of ½|a|², taken from Q in the actor's objective
    detector_decay: float  # of the detectors' weights per unit of their rate, as AdamW's
    geometry_decay: float  # share of their weights of all but properties that is taken away
    discount: float  # γ
    reward_scale: float  # of rewards; keeps the bounds of Q, whatever γ is
    property_dropout: float  # of transitions where a block's properties are hidden


class Engine(Protocol):
    """An algorithm's actor, critics, their targets and optimizers, somewhere.

    The targets start as copies. The table of programs may grow between updates.
    """

    name: str

    def update(self, batch: Batch, values: UpdateValues) -> None:
        """One update, all gradients at the parameters before it."""

    def end_episode(self) -> None:
        """An episode has ended: DPG copies both networks to their targets (paper, appendix)."""

    def actor_tensors(self) -> dict[str, Float32]:
        """The actor's weights now, float32, owned by the caller."""

    def metrics(self) -> dict[str, float]:
        """Of the latest update: `critic_loss`, `mean_q`, `actor_gradient_norm`; {} before it."""

    def tensors(self) -> dict[str, NDArray[np.generic]]:
        """Everything an update depends on, owned by the caller.

        Names: `actor.*`, `critic.*` (TD3's are `critic_1`, `critic_2`), `target_actor.*`,
        `target_critic.*`, then for each network `adam.actor.m.*`, `adam.actor.v.*` (first and
        second moments, shaped as the parameters) and `adam.actor.step` (int64 []).
        """

    def load_tensors(self, tensors: dict[str, NDArray[np.generic]]) -> None:
        """The inverse of `tensors`; TensorError when names or shapes differ."""
