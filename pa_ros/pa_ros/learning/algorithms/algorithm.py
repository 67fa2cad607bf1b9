"""An algorithm: its settings, a function that makes its engine, and its values in recipes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import Registry
from pa_ros.core.update import Engine
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.programs import ProgramTable

MakeEngine = Callable[[NetworkConfig, Any, ProgramTable, np.random.Generator], Engine]
"""Makes an engine with random initial weights, for settings of the algorithm's type."""


@dataclass(frozen=True)
class Algorithm:
    """One way to learn; `config.ALGORITHM` is its name.

    `values` are settings that this algorithm changes under a recipe, by the recipe's name and
    then by dotted path (`pa_ros.learning.recipes`).
    """

    config: type[LearnerConfig]
    make_engine: MakeEngine
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


class Algorithms(Registry[Algorithm]):
    """Algorithms by name: the one that their settings state."""

    def register(self, name: str, item: Algorithm) -> Algorithm:
        """Add an algorithm; ConfigError if its settings state another name."""
        said = getattr(item.config, "ALGORITHM", None)
        if said != name:
            raise ConfigError(
                f"algorithm {name}: expected ALGORITHM = {name!r} in {item.config.__name__}, "
                f"got {said!r}"
            )
        return super().register(name, item)
