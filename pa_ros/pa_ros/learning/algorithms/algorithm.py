"""What an algorithm is: its settings, what makes its engine, and its values under protocols."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.registry import Registry
from pa_ros.core.update import Engine
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.programs import ProgramTable

MakeEngine = Callable[[NetworkConfig, Any, ProgramTable, np.random.Generator], Engine]
"""An engine with random initial weights, for settings of the algorithm's own type."""


@dataclass(frozen=True)
class Algorithm:
    """One way to learn, of which a learner needs no more; `config.ALGORITHM` is its name.

    `values` are those of settings that differ under a protocol, by the protocol's name and then
    as `pa_ros.learning.protocols` has them.
    """

    config: type[LearnerConfig]
    make_engine: MakeEngine
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def engine(
        self,
        network: NetworkConfig,
        config: LearnerConfig,
        table: ProgramTable,
        rng: np.random.Generator,
    ) -> Engine:
        """What `make_engine` makes; ConfigError, with the algorithm's name, if that is none."""
        name = config.ALGORITHM
        try:
            engine = self.make_engine(network, config, table, rng)
        except PaError:
            raise
        except Exception as error:  # whatever code of others raises
            raise ConfigError(
                f"algorithm {name}: expected what docs/extending.md says of algorithms, got "
                f"{type(error).__name__}: {error}"
            ) from error
        if not isinstance(engine, Engine):
            raise ConfigError(f"algorithm {name}: expected an Engine, got {engine!r}")
        return engine


class Algorithms(Registry[Algorithm]):
    """By the names that their settings say: a learner finds its algorithm by them."""

    def register(self, name: str, item: Algorithm) -> Algorithm:
        """Add an algorithm; ConfigError if its settings say another name, or none."""
        said = getattr(item.config, "ALGORITHM", None)
        if said != name:
            raise ConfigError(
                f"algorithm {name}: expected ALGORITHM = {name!r} in {item.config.__name__}, "
                f"got {said!r}"
            )
        return super().register(name, item)
