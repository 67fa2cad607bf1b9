"""The reward as a replaceable term of the task."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float64


class Reward(ABC):
    """What a state earns under a program: a pure function of the verifier's two answers.

    Arena and learner share one, so what relabeling teaches is what the arena would have paid.
    Subclasses are frozen dataclasses: their `repr` says in checkpoints which reward was paid.
    """

    uses_measure: ClassVar[bool] = True
    """False: a function of `satisfied` alone. Relabeling then keeps one bit per program."""

    @abstractmethod
    def __call__(self, satisfied: NDArray[np.bool_], measure: Float64) -> Float64:
        """Rewards [...] for `satisfied` [...] and the relation's measure [...] (m)."""


@dataclass(frozen=True)
class Sparse(Reward):
    """One number where the program is satisfied, another elsewhere (paper: +1 and -1)."""

    satisfied: float = 1.0
    otherwise: float = -1.0
    uses_measure: ClassVar[bool] = False

    def __call__(self, satisfied: NDArray[np.bool_], measure: Float64) -> Float64:
        # Exact, one product being 0; of a single state a tenth of np.where's time.
        rewards: Float64 = satisfied * self.satisfied + ~satisfied * self.otherwise
        return rewards
