"""What the library is told of each family of networks; others are for torch alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.language import Program
from pa_ros.native import _fused
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import Canonical, Family, Programmable, codes_of
from pa_ros.networks.slots import slot_matrices
from pa_ros.world.programs import Int32, ProgramTable
from pa_ros.world.properties import truth_matrix


class FusedFamily(ABC):
    """How the library computes a family."""

    @abstractmethod
    def describe(self, network: NetworkConfig, critic: bool) -> _fused.Network:
        """The actor or the critic."""

    @abstractmethod
    def tell(self, engine: _fused.Engine, network: NetworkConfig, table: ProgramTable) -> None:
        """A table's programs; UnsupportedProgramError for one that cannot be told."""

    @abstractmethod
    def act(
        self, actor: _fused.Actor, network: NetworkConfig,
        seen: tuple[Float32, Float32, int], program: Program, action: Float32,
    ) -> None:  # fmt: skip
        """Write the action for objects, arm and hand index."""


class _Trunk(FusedFamily):
    def describe(self, network: NetworkConfig, critic: bool) -> _fused.Network:
        truth = truth_matrix(network.vocabulary)  # [16, V]
        return _fused.Network.trunk(
            hidden=network.hidden,
            attention=network.attention,
            group_sizes=list(network.vocabulary.group_sizes),
            truth=np.where(truth.any(0), truth.argmax(0), -1).tolist(),
            detectors=network.family.detects(critic),
            hide_properties=not network.relations_see_properties,
            critic=critic,
            position_scale=network.position_scale,
            self_weight=network.self_weight,
        )

    def tell(self, engine: _fused.Engine, network: NetworkConfig, table: ProgramTable) -> None:
        engine.set_programs(*table.arrays())

    def act(
        self, actor: _fused.Actor, network: NetworkConfig,
        seen: tuple[Float32, Float32, int], program: Program, action: Float32,
    ) -> None:  # fmt: skip
        actor.act_on_program(*seen, *_flat(program, network), action)


class _Mlp(FusedFamily):
    def describe(self, network: NetworkConfig, critic: bool) -> _fused.Network:
        shapes, colors = (matrix.argmax(0).tolist() for matrix in slot_matrices(network.vocabulary))
        return _fused.Network.canonical(
            hidden=network.canonical_hidden,
            words=len(network.vocabulary.words),
            slots=list(zip(shapes, colors, strict=True)),
            critic=critic,
            position_scale=network.position_scale,
        )

    def tell(self, engine: _fused.Engine, network: NetworkConfig, table: ProgramTable) -> None:
        (one_hots,) = network.family.codes(table)
        engine.set_targets(_words(one_hots))

    def act(
        self, actor: _fused.Actor, network: NetworkConfig,
        seen: tuple[Float32, Float32, int], program: Program, action: Float32,
    ) -> None:  # fmt: skip
        actor.act_on_target(*seen, _target(program, network), action)


FUSED: dict[type[Family], FusedFamily] = {Programmable: _Trunk(), Canonical: _Mlp()}


@lru_cache(maxsize=1024)
def _flat(program: Program, network: NetworkConfig) -> tuple[Int32, Int32, Int32]:
    """`op`, `a` and `b` of the flat form, each [1, L]."""
    op, a, b = (code.astype(np.int32, copy=False) for code in codes_of(program, network))
    return op, a, b


@lru_cache(maxsize=1024)
def _target(program: Program, network: NetworkConfig) -> Int32:
    (one_hots,) = codes_of(program, network)
    return _words(one_hots)


def _words(one_hots: NDArray[np.generic]) -> Int32:
    """The two words of each target, [P, 2]."""
    return np.stack([np.flatnonzero(row) for row in one_hots]).astype(np.int32)
