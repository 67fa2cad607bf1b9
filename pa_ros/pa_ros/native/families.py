"""Each family of networks as the C++ library takes it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.language import MIN_MAX, PRODUCT, Logic, Program, Vocabulary
from pa_ros.language.flat import Compiled
from pa_ros.native import _fused
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import (
    Canonical,
    Family,
    Programmable,
    codes_of,
    family_of,
    slot_values,
)
from pa_ros.world.programs import Int32, ProgramTable


def _world(network: NetworkConfig) -> dict[str, Any]:
    """The world as the library takes it, with inputs as networks see them."""
    world, words = network.world, []
    for group in world.schema:
        known, by = group.features.prototypes, group.features.scale
        for word in world.vocabulary[group.name]:
            numbers = [by * number for number in known.get(word, ())]
            at = world.schema.slices[group.name].start if numbers else 0
            words.append((at, numbers, by * group.features.tolerance))
    return {
        "arm_features": world.arm_features,
        "actions": world.actions,
        "scale": network.input_scales.tolist(),
        "group_sizes": list(world.vocabulary.group_sizes),
        "words": words,
    }


class FusedTrunk:
    """Programmable networks, which take flat programs."""

    def describe(
        self, network: NetworkConfig, critic: bool, logic: Logic = PRODUCT
    ) -> _fused.Network:
        """The actor or the critic."""
        return _fused.Network.trunk(
            hidden=network.hidden,
            attention=network.attention,
            detectors=family_of(network).detects(critic),
            hide_properties=not network.relations_see_properties,
            critic=critic,
            self_weight=network.self_weight,
            relations=network.vocabulary.relation_inputs,
            min_max=logic == MIN_MAX,
            roles=network.vocabulary.moves_objects,
            avoids=network.vocabulary.avoids,
            upper_layers=network.upper_layers,
            **_world(network),
        )

    def set_programs(self, engine: _fused.Engine, table: ProgramTable) -> None:
        """Pass a table's programs."""
        engine.set_programs(**table.compiled()._asdict())

    def set_program(self, actor: _fused.Actor, program: Program, network: NetworkConfig) -> None:
        """Let an actor act on a program; ProgramError if it cannot be compiled."""
        actor.set_program(**_compiled(program, network.vocabulary)._asdict())


@lru_cache(maxsize=64)  # an agent goes back and forth between a few programs
def _compiled(program: Program, vocabulary: Vocabulary) -> Compiled:
    return ProgramTable(vocabulary, [program]).compiled()


class Mlp:
    """Canonical networks, which take the words of a target."""

    def describe(
        self, network: NetworkConfig, critic: bool, logic: Logic = PRODUCT
    ) -> _fused.Network:
        """The actor or the critic; they evaluate no programs, so `logic` is not used."""
        world = network.world
        rows = [
            [world.vocabulary.row.get(value, -1) for value in group.features.values]
            for group in world.schema
        ]
        slots = slot_values(world).tolist()
        return _fused.Network.canonical(
            hidden=network.canonical_hidden,
            slots=[[of[i] for of, i in zip(rows, slot, strict=True)] for slot in slots],
            critic=critic,
            **_world(network),
        )

    def set_programs(self, engine: _fused.Engine, table: ProgramTable) -> None:
        """Pass a table's programs; NetworkError for one that cannot be represented."""
        (one_hots,) = Canonical().codes(table)
        engine.set_targets(_words(one_hots))

    def set_program(self, actor: _fused.Actor, program: Program, network: NetworkConfig) -> None:
        """Let an actor act on a program; NetworkError if it cannot be represented."""
        (one_hots,) = codes_of(program, network)
        actor.set_target(_words(one_hots))


FUSED: dict[type[Family], FusedTrunk | Mlp] = {Programmable: FusedTrunk(), Canonical: Mlp()}


def _words(one_hots: NDArray[np.generic]) -> Int32:
    """The words of each target, [P, groups]."""
    return np.stack([np.flatnonzero(row) for row in one_hots]).astype(np.int32)
