"""Rewards: registered functions of the verifier's two answers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, ClassVar

import numpy as np

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.extensions import ExtensionError, guarded
from pa_ros.core.registry import Registry
from pa_ros.core.settings import canonical_json, read_json


def _fits(rewards: Any, _: Reward, satisfied: Any, measure: Any) -> bool:
    """Whether there is a finite number for each state."""
    found, shape = np.asarray(rewards), np.broadcast_shapes(np.shape(satisfied), np.shape(measure))
    return found.shape == shape and found.dtype.kind in "iuf" and bool(np.isfinite(found).all())


@dataclass(frozen=True)
class Reward(ABC):
    """The reward of a state under a program, a pure function of the verifier's two answers.

    Arena and learner use the same one, so relabeled rewards equal the rewards that the arena would
    give. Subclasses are frozen dataclasses of numbers with defaults. Register them in REWARDS to
    name them on command lines and in parameters, and to announce them on a graph.
    """

    uses_measure: ClassVar[bool] = True
    """False if the reward depends on `satisfied` alone. Relabeling then keeps one bit each."""

    def __init_subclass__(cls) -> None:
        """Guard the function of an extension."""
        expected = "a finite number for each state"
        own = guarded(f"reward {cls.__name__}", cls.__call__, _fits, expected)
        setattr(cls, "__call__", own)  # noqa: B010

    @abstractmethod
    def __call__(self, satisfied: Any, measure: Any) -> Any:
        """Rewards [...] for `satisfied` [...] and the relation's measure [...] (m).

        The arguments are arrays of bool and float64 for many states, or Python's bool and float for
        one; both must give the same bits.
        """

    def to_json(self) -> str:
        """Canonical JSON of name and parameters; equal rewards have equal text."""
        kind = type(self)
        name = next((name for name in REWARDS if REWARDS[name] is kind), kind.__name__)
        return canonical_json({"name": name, **asdict(self)})


@dataclass(frozen=True)
class Sparse(Reward):
    """One number where the program is satisfied, another elsewhere (paper: +1 and -1)."""

    satisfied: float = 1.0
    otherwise: float = -1.0
    uses_measure: ClassVar[bool] = False

    def __call__(self, satisfied: Any, measure: Any) -> Any:
        # One of the products is 0, so the sum is exact.
        return satisfied * self.satisfied + (1 - satisfied) * self.otherwise


REWARDS: Registry[type[Reward]] = Registry("reward")
REWARDS.register("sparse", Sparse)


def reward_from(text: str) -> Reward:
    """A registered reward by its name, or by the JSON of `Reward.to_json`.

    Parameters that the JSON omits keep their defaults. ConfigError for an unknown name, unknown
    parameters, parameters that are not finite numbers, and rewards without a number for each state.
    """
    name, parameters = text, {}
    if text.lstrip().startswith("{"):
        try:
            parameters = read_json(text)
            name = str(parameters.pop("name"))
        except (ValueError, KeyError) as error:
            raise ConfigError(
                f"reward: expected a name, or JSON with name and parameters: {error!r}: "
                f"got {text[:200]!r}"
            ) from error
    kind = REWARDS[name]
    try:
        return _checked(name, kind, parameters)
    except Exception as error:  # of an extension
        if isinstance(error, PaError) and not isinstance(error, ExtensionError):
            raise
        raise ConfigError(
            f"reward {name}: expected a dataclass with defaults that takes numbers and arrays, got "
            f"{error!r}"
        ) from error


def _checked(name: str, kind: type[Reward], parameters: Mapping[str, Any]) -> Reward:
    known = asdict(kind())
    for key, value in parameters.items():
        # JSON may come from another process, so its parameters are checked by name and type.
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if key not in known or not number or not isfinite(value):
            raise ConfigError(
                f"reward {name}: expected finite numbers of {list(known)}, got {key} = {value!r}"
            )
    reward = kind(**{key: type(known[key])(value) for key, value in parameters.items()})
    # Try it on one state and on two, so that an error of an extension shows here.
    reward(True, 0.1)
    reward(np.array([True, False]), np.array([0.1, 0.5]))
    return reward
