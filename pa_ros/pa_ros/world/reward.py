"""The reward as a replaceable term of the task."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.registry import Registry
from pa_ros.core.settings import canonical_json, read_json


@dataclass(frozen=True)
class Reward(ABC):
    """What a state earns under a program: a pure function of the verifier's two answers.

    Arena and learner share one, so what relabeling teaches is what the arena would have paid.
    Subclasses are frozen dataclasses of numbers with defaults; registered in REWARDS they can be
    named on command lines and in parameters, and be announced on a graph.
    """

    uses_measure: ClassVar[bool] = True
    """False: a function of `satisfied` alone. Relabeling then keeps one bit per program."""

    @abstractmethod
    def __call__(self, satisfied: Any, measure: Any) -> Any:
        """Rewards [...] for `satisfied` [...] and the relation's measure [...] (m).

        Arrays of bool and float64 for many states, Python's bool and float for one: an expression
        that is right for both and gives the same bits.
        """

    def to_json(self) -> str:
        """Canonical JSON of name and parameters: equal text, equal rewards."""
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
        return satisfied * self.satisfied + (1 - satisfied) * self.otherwise  # one product is 0


REWARDS: Registry[type[Reward]] = Registry("reward")
REWARDS.register("sparse", Sparse)


def reward_from(text: str) -> Reward:
    """A registered reward by its name, or by the JSON of `Reward.to_json`.

    What the JSON leaves out has its default. ConfigError for an unknown name, with the known ones,
    for parameters that are none of its own, or no finite numbers, and for what is registered but
    isn't as `Reward` says.
    """
    if not text.lstrip().startswith("{"):
        return _made(text)
    try:
        values = read_json(text)
        name = str(values.pop("name"))
        known = asdict(_made(name))
    except (ValueError, KeyError) as error:
        raise ConfigError(
            f"reward: expected a name, or JSON with name and parameters: {error!r}: "
            f"got {text[:200]!r}"
        ) from error
    for parameter, value in values.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if parameter not in known or not number or not abs(value) < float("inf"):
            raise ConfigError(
                f"reward: expected finite numbers of {list(known)}, got {parameter} = {value!r}"
            )
    return _made(name, **{key: type(known[key])(value) for key, value in values.items()})


def _made(name: str, **parameters: Any) -> Reward:
    """A registered reward, asked for one state and for two, so that it fails here if at all."""
    kind: Any = REWARDS[name]
    try:
        reward = kind(**parameters)
        if not isinstance(reward, Reward):
            raise ConfigError(f"expected a Reward that is a frozen dataclass, got {reward!r}")
        one, two = reward(True, 0.1), reward(np.array([True, False]), np.array([0.1, 0.5]))
        if np.shape(one) != () or not np.isfinite(np.asarray(one, np.float64)):
            raise ConfigError(f"expected a finite number, got {one!r}")
        if np.shape(two) != (2,) or not np.isfinite(np.asarray(two, np.float64)).all():
            raise ConfigError(f"expected finite numbers [2], got {two!r}")
    except PaError as error:
        raise ConfigError(f"reward {name}: {error}") from error
    except Exception as error:  # whatever code of others raises
        raise ConfigError(
            f"reward {name}: expected what docs/extending.md says of rewards, got "
            f"{type(error).__name__}: {error}"
        ) from error
    return reward
