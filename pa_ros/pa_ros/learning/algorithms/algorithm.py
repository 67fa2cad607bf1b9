"""What an algorithm is: its settings, what makes its engine, and its values under protocols."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

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
