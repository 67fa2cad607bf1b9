"""Families of networks by name: their tensors, initial weights, and how they take programs.

torch is imported when it is needed. `pa_ros.native.families` has those that C++ computes.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.core.registry import Registry
from pa_ros.language import And, Goal, Program, Vocabulary, Word, stages
from pa_ros.language.flat import compile_program
from pa_ros.networks.errors import NetworkError
from pa_ros.world.programs import Int32, ProgramTable
from pa_ros.world.world import World

if TYPE_CHECKING:
    from pa_ros.networks.config import NetworkConfig

LILLICRAP_OUTPUT_SCALE = 3e-3  # Lillicrap et al. 2015, section 7
BLIND = tuple(f"{x}.weight" for x in ("query", "context", "local.0", "message.0", "avoid.0"))
"""Those whose input is ω; without `relations_see_properties` they are 0 for properties."""

Shapes = dict[str, tuple[int, ...]]
"""Shapes of tensors by state-dict name."""
Tensors = dict[str, Float32]
"""Weights by state-dict name."""
Codes = tuple[Float32 | Int32, ...]
"""Programs as the networks take them, arrays [P, …] for the P programs of a table: the fields of
`Compiled`, or what another family needs."""


def check_goal(network: NetworkConfig, goal: Goal) -> None:
    """Raise NetworkError or ProgramError if networks cannot represent a program of a goal."""
    for program in stages(goal):
        family_of(network).check(program.sets_alone, network.vocabulary)


class Family(ABC):
    """Actors and critics of one kind. `critic` says which of the two is meant."""

    evaluates_programs: ClassVar[bool]
    """Whether programs are evaluated over Φ, so that degrees exist."""
    sizes: ClassVar[Mapping[str, str]] = {"hidden": "hidden"}
    """Settings that an actor's tensors depend on, by their names in its `architecture`."""
    actor: str = ""
    """Name of the family with the same actors; empty: no other has them."""

    @abstractmethod
    def modules(self) -> tuple[type[Any], type[Any]]:
        """Classes of actor and critic, torch modules that are made from a NetworkConfig.

        The actor is called with objects [B, N, F], arm [B, A], `programs` and the hand's index, and
        returns actions [B, K, J]. The critic has `trunk`, which takes the same and returns
        [B, K, H], and `head`, which takes that and an action and returns Q [B, K] by a layer
        `output`, whose initial bias `initial_critic` sets.
        """

    @abstractmethod
    def codes(self, table: ProgramTable) -> Codes:
        """A table's programs. NetworkError if the networks cannot represent one of them."""

    @abstractmethod
    def programs(self, *codes: Any) -> Any:
        """Programs as the modules take them, from `codes` gathered as tensors [B, K, …]."""

    @abstractmethod
    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        """Raise NetworkError if the networks cannot represent this program, ProgramError for an
        unknown word."""

    def shapes(self, config: NetworkConfig, critic: bool) -> Shapes:
        """Shape of each tensor by state-dict name; by default those of the modules."""
        made = self.modules()[critic](config)
        return {name: tuple(tensor.shape) for name, tensor in made.state_dict().items()}

    def initial(self, config: NetworkConfig, critic: bool, rng: np.random.Generator) -> Tensors:
        """Random initial weights; the same state of `rng` gives the same. By default, those that
        the modules have when they are made."""
        import torch

        with torch.random.fork_rng(devices=()):
            torch.manual_seed(int(rng.integers(2**63)))
            made = self.modules()[critic](config)
        return {name: tensor.numpy() for name, tensor in made.state_dict().items()}

    def detects(self, critic: bool) -> bool:
        """Whether the actor or the critic learns its Φ by detectors."""
        return False

    @property
    def is_told_words(self) -> bool:
        """Whether actor or critic are told which words are true of an object."""
        return False


class DetectorFamily(Family):
    """Programs are evaluated over Φ, which detectors learn: modules extend
    `pa_ros.networks.programmable.Detectors`, and take `programmable.Programs`."""

    evaluates_programs: ClassVar[bool] = True

    def codes(self, table: ProgramTable) -> Codes:
        return table.compiled()

    def programs(self, *codes: Any) -> Any:
        from pa_ros.networks.programmable import Programs

        return Programs(*codes)

    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        compile_program(program, vocabulary)

    def detects(self, critic: bool) -> bool:
        return True


@dataclass(frozen=True)
class Programmable(DetectorFamily):
    """The paper's networks (`pa_ros.networks.programmable`). Φ is learned by detectors, or true."""

    actor_detects: bool = True
    critic_detects: bool = True
    actor: str = "programmable"
    sizes: ClassVar[Mapping[str, str]] = {"hidden": "hidden", "attention": "attention"}

    def modules(self) -> tuple[type[Any], type[Any]]:
        from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic

        return ProgrammableActor, ProgrammableCritic

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
        if config.vocabulary.avoids:
            shapes |= linear("avoid.0", hidden, columns) | {"avoid.1.weight": (hidden, hidden)}
        for layer in range(config.upper_layers):
            shapes |= linear(f"upper.{layer}", hidden, hidden)
        if not critic:
            return shapes | linear("output", actions, hidden)
        return shapes | linear("action", hidden, actions) | linear("output", 1, hidden)

    def initial(self, config: NetworkConfig, critic: bool, rng: np.random.Generator) -> Tensors:
        output_scale = None if critic else config.actor_output_scale
        shapes, world = self.shapes(config, critic), config.world
        tensors = uniform(shapes, rng, output_scale, config.detector_init_scale)
        if self.detects(critic) and not config.detectors_have_biases:
            tensors["detectors.bias"][:] = 0.0
        if self.detects(critic) and not config.detectors_see_arm:
            tensors["detectors.weight"][:, world.object_features :] = 0.0
        if not config.relations_see_properties:
            for weight in (tensors[name] for name in BLIND if name in tensors):
                columns = weight.reshape(len(weight), -1, world.columns)
                columns[..., world.schema.properties] = 0.0
        return tensors

    def detects(self, critic: bool) -> bool:
        return self.critic_detects if critic else self.actor_detects

    @property
    def is_told_words(self) -> bool:
        return not (self.actor_detects and self.critic_detects)


class Canonical(Family):
    """MLPs on the flattened Ω (`pa_ros.networks.canonical`);
    they take the target as one-hots [P, V]."""

    evaluates_programs: ClassVar[bool] = False
    sizes: ClassVar[Mapping[str, str]] = {"hidden": "canonical_hidden"}

    def modules(self) -> tuple[type[Any], type[Any]]:
        from pa_ros.networks.canonical import CanonicalActor, CanonicalCritic

        return CanonicalActor, CanonicalCritic

    def shapes(self, config: NetworkConfig, critic: bool) -> Shapes:
        hidden = config.canonical_hidden
        actions = config.world.actions
        enters = actions if critic else 0  # at the second hidden layer
        shapes = linear("layers.0", hidden, canonical_inputs(config.world))
        shapes |= linear("layers.1", hidden, hidden + enters)
        return shapes | linear("output", 1 if critic else actions, hidden)

    def initial(self, config: NetworkConfig, critic: bool, rng: np.random.Generator) -> Tensors:
        return uniform(self.shapes(config, critic), rng, LILLICRAP_OUTPUT_SCALE)

    def codes(self, table: ProgramTable) -> Codes:
        programs = table.programs
        return (np.stack([target_one_hots(program, table.vocabulary) for program in programs]),)

    def programs(self, *codes: Any) -> Any:
        return codes[0]

    def check(self, program: Program, vocabulary: Vocabulary) -> None:
        target_one_hots(program, vocabulary)

    @property
    def is_told_words(self) -> bool:
        return True


FAMILIES: Registry[Family] = Registry("network family")
FAMILIES.register("programmable", Programmable())
FAMILIES.register("distilled-critic", Programmable(critic_detects=False))
FAMILIES.register("true-properties", Programmable(False, False, actor=""))
FAMILIES.register("canonical", Canonical())


def family_of(network: NetworkConfig) -> Family:
    """The family of a network's actor and critic."""
    return FAMILIES[network.family]


def codes_of(program: Program, network: NetworkConfig) -> Codes:
    """One program as the networks take it, arrays [1, …]; NetworkError if they cannot."""
    return family_of(network).codes(ProgramTable(network.vocabulary, [program]))


def uniform(
    shapes: Shapes,
    rng: np.random.Generator,
    output_scale: float | None,
    detector_scale: float = 1.0,
) -> Tensors:
    """Weights uniform in ±1/√fan-in, torch's default for Linear, and of the detectors in
    `detector_scale` times that; with `output_scale` those of the layer "output" in ± that."""
    tensors: Tensors = {}
    for name, shape in shapes.items():
        layer = name.rpartition(".")[0]
        bound = 1.0 / math.sqrt(shapes[f"{layer}.weight"][-1])
        if layer == "output" and output_scale is not None:
            bound = output_scale
        if layer == "detectors":
            bound *= detector_scale
        tensors[name] = rng.uniform(-bound, bound, shape).astype(np.float32)
    return tensors


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
