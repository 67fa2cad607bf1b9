"""The reward as a replaceable term of the task."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar


class Reward(ABC):
    """What a state earns under a program: a pure function of the verifier's two answers.

    Arena and learner share one, so what relabeling teaches is what the arena would have paid.
    Subclasses are frozen dataclasses: their `repr` says in checkpoints which reward was paid.
    """

    uses_measure: ClassVar[bool] = True
    """False: a function of `satisfied` alone. Relabeling then keeps one bit per program."""

    @abstractmethod
    def __call__(self, satisfied: Any, measure: Any) -> Any:
        """Rewards [...] for `satisfied` [...] and the relation's measure [...] (m).

        Arrays of bool and float64 for many states, Python's bool and float for one: an expression
        that is right for both and gives the same bits.
        """


@dataclass(frozen=True)
class Sparse(Reward):
    """One number where the program is satisfied, another elsewhere (paper: +1 and -1)."""

    satisfied: float = 1.0
    otherwise: float = -1.0
    uses_measure: ClassVar[bool] = False

    def __call__(self, satisfied: Any, measure: Any) -> Any:
        return satisfied * self.satisfied + (1 - satisfied) * self.otherwise  # one product is 0
