"""Families of networks: the shapes of their tensors and the form in which they take programs.

How a family is computed is in `pa_ros.networks.modules` (torch) and `pa_ros.native.families` (C++).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.language import And, Program, Vocabulary, Word
from pa_ros.language.flat import compile_program
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.world.programs import Int32, ProgramTable
from pa_ros.world.world import World

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
        if several := config.vocabulary.relation_inputs:
            shapes["relation.weight"] = (hidden, several)
        for layer in range(config.upper_layers):
            shapes |= linear(f"upper.{layer}", hidden, hidden)
        if not critic:
            return shapes | linear("output", actions, hidden)
        return shapes | linear("action", hidden, actions) | linear("output", 1, hidden)

    def output_scale(self, config: NetworkConfig, critic: bool) -> float | None:
        return None if critic else config.actor_output_scale

    def codes(self, table: ProgramTable) -> Codes:
        codes: Codes = table.arrays()
        if table.vocabulary.relation_inputs:
            codes = (*codes, table.relations())
        return (*codes, table.roles()) if table.vocabulary.moves_objects else codes

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


# Inputs of canonical networks: a slot for each kind of block, and the target as one-hots


def target_one_hots(program: Program, vocabulary: Vocabulary) -> Float32:
    """The target's properties as one-hots over the vocabulary, [V], then, where it has several, one
    of the relation, [V + R].

    Raises NetworkError unless the program is an AND of one word of each group, and asks
    for one of the vocabulary's relations.
    """
    words, target = program.words, program.target
    flat = isinstance(target, Word) or (
        isinstance(target, And) and all(isinstance(part, Word) for part in target.operands)
    )
    rows = vocabulary.relation_row
    if program.relation not in rows:
        raise NetworkError(
            f"canonical networks: expected a relation of {', '.join(rows)}, got {program}",
            code="networks.unsupported_program",
        )
    found = [sum(word in group.words for word in words) for group in vocabulary.groups]
    if not (flat and len(words) == len(found) and set(found) == {1}):
        groups = ", ".join(group.name for group in reversed(vocabulary.groups))
        raise NetworkError(
            f"canonical networks: expected {program.relation}(HAND, AND({groups})), got {program}",
            code="networks.unsupported_program",
        )
    one_hots = np.zeros(len(vocabulary.words) + vocabulary.relation_inputs, np.float32)
    one_hots[[vocabulary.row[word] for word in words]] = 1.0
    if vocabulary.relation_inputs:
        one_hots[len(vocabulary.words) + rows[program.relation]] = 1.0
    return one_hots


def slot_values(world: World) -> NDArray[np.int64]:
    """[S, groups]: which value of each group the block has that fills a slot, in order of slots.

    There is a slot for every kind of block that the vocabulary has words for.
    """
    named = [
        [i for i, value in enumerate(g.features.values) if value in world.vocabulary[g.name]]
        for g in world.schema
    ]
    return np.array([*product(*named)], np.int64).reshape(-1, len(named))


def canonical_inputs(world: World) -> int:
    """Size of the canonical networks' input: hand, block slots, arm, target one-hots."""
    slots = 1 + len(slot_values(world))
    target = len(world.vocabulary.words) + world.vocabulary.relation_inputs
    return slots * world.object_features + world.arm_features + target
