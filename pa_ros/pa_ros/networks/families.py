"""Families of networks: an object for all that depends on the kind of actor and critic.

Other rooms register what they know of a family by its type (`functools.singledispatch`): the fused
engine how to compute it, benchmarks what it costs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pa_ros.core.experience import Float32
from pa_ros.language import Program, Vocabulary
from pa_ros.language.flat import compile_program
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.slots import canonical_inputs, target_one_hots
from pa_ros.world.programs import Int32, ProgramTable

if TYPE_CHECKING:
    from torch import Tensor

LILLICRAP_OUTPUT_SCALE = 3e-3  # Lillicrap et al. 2015, section 7

Shapes = dict[str, tuple[int, ...]]
"""Shapes of tensors by state-dict name."""
Codes = tuple[Float32 | Int32, ...]
"""What networks are told of each program of a table, arrays [P, …]."""


@dataclass(frozen=True)
class Family(ABC):
    """Actors and critics of one kind."""

    name: str
    evaluates_programs: ClassVar[bool]
    """Whether a program is run over Φ, so that degrees can be shown, and properties be hidden."""

    @abstractmethod
    def shapes(self, config: NetworkConfig, critic: bool) -> Shapes:
        """Shape of each of the actor's or critic's tensors by state-dict name, in order."""

    @abstractmethod
    def output_scale(self, config: NetworkConfig, critic: bool) -> float | None:
        """Bound of the last layer's initial weights; None: as any layer's."""

    @abstractmethod
    def modules(self) -> tuple[type[Any], type[Any]]:
        """The torch reference, actor and critic: made of a config, called with `goals`."""

    @abstractmethod
    def codes(self, table: ProgramTable) -> Codes:
        """NetworkError if a program of the table cannot be told."""

    @abstractmethod
    def goals(self, *codes: Tensor) -> Any:
        """What the modules take for `codes` [B, K, …] gathered from a table's."""

    @abstractmethod
    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        """NetworkError if the networks cannot be told this program, ProgramError if
        they know not all of its words."""

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

    def modules(self) -> tuple[type[Any], type[Any]]:
        from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic

        return ProgrammableActor, ProgrammableCritic

    def codes(self, table: ProgramTable) -> Codes:
        several = table.vocabulary.relation_inputs
        return (*table.arrays(), table.relations()) if several else table.arrays()

    def goals(self, *codes: Tensor) -> Any:
        from pa_ros.networks.programmable import Programs

        return Programs(*codes)

    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        """Any program of their vocabulary can be told."""
        compile_program(program, vocabulary)

    def detects(self, critic: bool) -> bool:
        return self.critic_detects if critic else self.actor_detects


@dataclass(frozen=True)
class Canonical(Family):
    """MLPs on the flattened Ω (`pa_ros.networks.canonical`), told the target as one-hots [P, V]."""

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

    def modules(self) -> tuple[type[Any], type[Any]]:
        from pa_ros.networks.canonical import CanonicalActor, CanonicalCritic

        return CanonicalActor, CanonicalCritic

    def codes(self, table: ProgramTable) -> Codes:
        programs = table.programs
        return (np.stack([target_one_hots(program, table.vocabulary) for program in programs]),)

    def goals(self, *codes: Tensor) -> Any:
        return codes[0]

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
    """What networks are told of one program, arrays [1, …]; NetworkError if nothing."""
    table = ProgramTable(network.vocabulary)
    table.add(program)
    return family_of(network).codes(table)


def linear(name: str, outputs: int, inputs: int) -> Shapes:
    """Shapes of a layer's weight and bias."""
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}
