"""Families of networks: the shapes of their tensors and the form in which they take programs.

How a family is computed is in `pa_ros.networks.modules` (torch) and `pa_ros.native.families` (C++).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pa_ros.core.experience import Float32
from pa_ros.language import Program, Vocabulary
from pa_ros.language.flat import compile_program
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.slots import canonical_inputs, target_one_hots
from pa_ros.world.programs import Int32, ProgramTable

LILLICRAP_OUTPUT_SCALE = 3e-3  # Lillicrap et al. 2015, section 7

Shapes = dict[str, tuple[int, ...]]
"""Shapes of tensors by state-dict name."""
Codes = tuple[Float32 | Int32, ...]
"""Programs as the networks take them, arrays [P, …] for the P programs of a table."""


@dataclass(frozen=True)
class Family(ABC):
    """Actors and critics of one kind."""

    name: str
    evaluates_programs: ClassVar[bool]
    """Whether programs are evaluated over Φ, so that degrees exist."""

    @abstractmethod
    def shapes(self, config: NetworkConfig, critic: bool) -> Shapes:
        """Shape of each of the actor's or critic's tensors by state-dict name, in order."""

    @abstractmethod
    def output_scale(self, config: NetworkConfig, critic: bool) -> float | None:
        """Bound of the last layer's initial weights; None: as any layer's."""

    @abstractmethod
    def codes(self, table: ProgramTable) -> Codes:
        """A table's programs. NetworkError if the networks cannot represent one of them."""

    @abstractmethod
    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        """Raise NetworkError if the networks cannot represent this program, ProgramError for an
        unknown word."""

    def detects(self, critic: bool) -> bool:
        """Whether the actor or the critic learns its Φ by detectors."""
        return False


@dataclass(frozen=True)
class Programmable(Family):
    """Programs run over Φ (`pa_ros.networks.programmable`): learned by detectors, or true."""

    actor_detects: bool
    critic_detects: bool
    evaluates_programs: ClassVar[bool] = True

    def shapes(self, config: NetworkConfig, critic: bool) -> Shapes:
        hidden, attention = config.hidden, config.attention
        columns, actions = config.world.columns, config.world.actions
        shapes: Shapes = {}
        if self.detects(critic):
            shapes |= linear("detectors", len(config.vocabulary.words), columns)
        shapes |= linear("query", attention, columns)
        shapes |= linear("context", attention, columns)
        shapes |= {"attention.weight": (attention,)}
        shapes |= linear("local.0", hidden, columns) | linear("local.1", hidden, hidden)
        shapes |= linear("message.0", hidden, 2 * columns)
        shapes |= linear("message.1", hidden, hidden)
        if several := config.relation_inputs:
            shapes["relation.weight"] = (hidden, several)
        if not critic:
            return shapes | linear("output", actions, hidden)
        return shapes | linear("action", hidden, actions) | linear("output", 1, hidden)

    def output_scale(self, config: NetworkConfig, critic: bool) -> float | None:
        return None if critic else config.actor_output_scale

    def codes(self, table: ProgramTable) -> Codes:
        several = table.vocabulary.relation_inputs
        return (*table.arrays(), table.relations()) if several else table.arrays()

    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        compile_program(program, vocabulary)

    def detects(self, critic: bool) -> bool:
        return self.critic_detects if critic else self.actor_detects


@dataclass(frozen=True)
class Canonical(Family):
    """MLPs on the flattened Ω (`pa_ros.networks.canonical`);
    they take the target as one-hots [P, V]."""

    evaluates_programs: ClassVar[bool] = False

    def shapes(self, config: NetworkConfig, critic: bool) -> Shapes:
        hidden = config.canonical_hidden
        actions = config.world.actions
        enters = actions if critic else 0  # at the second hidden layer
        shapes = linear("layers.0", hidden, canonical_inputs(config.world))
        shapes |= linear("layers.1", hidden, hidden + enters)
        return shapes | linear("output", 1 if critic else actions, hidden)

    def output_scale(self, config: NetworkConfig, critic: bool) -> float | None:
        return LILLICRAP_OUTPUT_SCALE

    def codes(self, table: ProgramTable) -> Codes:
        programs = table.programs
        return (np.stack([target_one_hots(program, table.vocabulary) for program in programs]),)

    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        target_one_hots(program, vocabulary)


FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Programmable("programmable", True, True),
        Programmable("distilled-critic", True, False),
        Programmable("true-properties", False, False),
        Canonical("canonical"),
    )
}


def family_of(network: NetworkConfig) -> Family:
    """The family of a network's actor and critic."""
    return FAMILIES[network.family]


def codes_of(program: Program, network: NetworkConfig) -> Codes:
    """One program as the networks take it, arrays [1, …]; NetworkError if they cannot."""
    table = ProgramTable(network.vocabulary)
    table.add(program)
    return family_of(network).codes(table)


def linear(name: str, outputs: int, inputs: int) -> Shapes:
    """Shapes of a layer's weight and bias."""
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}
