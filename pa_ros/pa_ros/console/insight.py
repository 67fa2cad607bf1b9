"""What an actor's networks make of a program at one moment: Φ, p, and the degrees in between."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64, Observation, PolicySnapshot
from pa_ros.language import (
    MIN_MAX,
    PRODUCT,
    And,
    Expression,
    Logic,
    Not,
    Or,
    Program,
    Word,
    degree,
    logic_named,
    relevance,
)
from pa_ros.networks.config import actor_config
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import family_of
from pa_ros.networks.inference import TorchActor


@dataclass(frozen=True)
class Node:
    """One node of a program's tree, and how far it describes each object."""

    depth: int  # 0: the target expression itself
    text: str  # AND, OR, NOT or a word
    degrees: Float64  # [N] in [0, 1]


@dataclass(frozen=True)
class Look:
    """Φ and p of all objects at one moment, hand included."""

    version: int  # of the weights
    words: tuple[str, ...]
    phi: Float32  # [V, N]
    p: Float64  # [N]; the hand's is 1; empty without a program
    tree: tuple[Node, ...]  # outer before inner, left to right


def logic_of(parameters: Mapping[str, Any]) -> Logic:
    """By which an agent acts that says these parameters of itself: who learns by products, and so
    did who had no choice yet. ConfigError for an unknown one."""
    if parameters.get("learning", True):
        return PRODUCT
    return logic_named(str(parameters.get("logic", PRODUCT.name)))


class Insight:
    """The detectors of one set of weights, their degrees taken and joined by `logic`.

    ConfigError if these have none, or don't fit.
    """

    def __init__(self, snapshot: PolicySnapshot, logic: Logic = MIN_MAX) -> None:
        network = actor_config(snapshot.architecture)
        if not family_of(network).evaluates_programs:
            raise ConfigError(f"the networks {network.family!r} evaluate no programs")
        try:
            self._inference = TorchActor(network, snapshot.tensors, logic)
        except NetworkError as error:
            raise ConfigError(str(error)) from error
        self._world, self._version, self._logic = network.world, snapshot.version, logic
        self._vocabulary = network.vocabulary

    def look(self, observation: Observation, program: Program | None) -> Look:
        """Raises ProgramError if the program is of another vocabulary."""
        phi = self._inference.properties(observation.objects, self._world.arm(observation))
        words, row = self._vocabulary.words, self._vocabulary.row
        if program is None:
            return Look(self._version, words, phi, np.zeros(0), ())
        p = relevance(program, phi.tolist(), row, observation.hand_index, self._logic)
        values = {word: phi[row[word]].astype(np.float64) for word in program.words}
        tree = tuple(_nodes(program.target, values.__getitem__, self._logic))
        return Look(self._version, words, phi, np.array(p), tree)


def _nodes(expression: Expression, value: Any, logic: Logic, depth: int = 0) -> Iterator[Node]:
    yield Node(depth, name_of(expression), np.asarray(degree(expression, value, logic)))
    match expression:
        case Not(operand):
            yield from _nodes(operand, value, logic, depth + 1)
        case And(operands) | Or(operands):
            for operand in operands:
                yield from _nodes(operand, value, logic, depth + 1)


def name_of(expression: Expression) -> str:
    """A node without what is below it: `AND`, `RED`."""
    return expression.name if isinstance(expression, Word) else type(expression).__name__.upper()
