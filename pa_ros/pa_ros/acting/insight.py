"""An explanation of a program at one moment: Φ, p, and the degrees of its parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pa_ros.acting.errors import ActingError
from pa_ros.acting.executing import Actor
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.experience import Float32, Float64, Observation, PolicySnapshot
from pa_ros.language import (
    HAND,
    MIN_MAX,
    PRODUCT,
    And,
    Expression,
    Logic,
    Not,
    Or,
    Program,
    Vocabulary,
    Word,
    degree,
    logic_named,
    parse_goal,
    stages,
)
from pa_ros.networks.config import actor_config
from pa_ros.networks.families import family_of


@dataclass(frozen=True)
class Node:
    """One node of a program's tree, and to what degree it describes each object."""

    depth: int  # 0: the target expression itself
    text: str  # AND, OR, NOT or a word
    degrees: Float64  # [N] in [0, 1]


@dataclass(frozen=True)
class Explanation:
    """Φ and p of all objects at one moment, hand included."""

    version: int  # of the weights
    objects: tuple[str, ...]  # [N] labels: "hand", "RED CUBE"
    words: tuple[str, ...]  # [V]
    phi: Float32  # [V, N]
    p: Float64  # [N]; the hand's is 1; empty without a program
    tree: tuple[Node, ...]  # parents before children, left to right

    def __str__(self) -> str:
        """A table: a row for each object, a column for each word, and p."""
        named = [*zip(self.words, self.phi, strict=True), *([("p", self.p)] if len(self.p) else [])]
        first = max(map(len, self.objects))
        rows = [" ".join([" " * first, *(f"{name:>5}" for name, _ in named)])]
        for i, label in enumerate(self.objects):
            cells = (f"{column[i]:{max(5, len(name))}.2f}" for name, column in named)
            rows.append(" ".join([f"{label:<{first}}", *cells]))
        return "\n".join(rows)


class Insight:
    """Explains programs by one set of weights; degrees are joined by `logic`."""

    def __init__(self, snapshot: PolicySnapshot, logic: Logic = MIN_MAX) -> None:
        """Raises ConfigError if the weights have no detectors, or don't fit their description."""
        network = actor_config(snapshot.architecture)
        if not family_of(network).evaluates_programs:
            raise ConfigError(f"the networks {network.family!r} evaluate no programs")
        try:
            self._actor = Actor.of(snapshot, logic)
        except ActingError as error:
            raise ConfigError(str(error)) from error
        self._world, self._version, self._logic = network.world, snapshot.version, logic

    def explain(self, observation: Observation, program: Program | None) -> Explanation:
        """Raises ProgramError if the program is of another vocabulary."""
        phi, vocabulary = self._actor.phi(observation), self._world.vocabulary
        words, row = vocabulary.words, vocabulary.row
        labels = self._world.schema.labels(observation.objects, observation.hand_index)
        if program is None:
            return Explanation(self._version, labels, words, phi, np.zeros(0), ())
        p = np.array(self._actor.relevance(observation, program))
        named = program.relation_alone.words
        values = {word: phi[row[word]].astype(np.float64) for word in named}
        hand = np.arange(phi.shape[1]) == observation.hand_index
        values[HAND.name] = hand.astype(np.float64)
        # Nobody needs an explanation of the hand, so the tree is that of the target alone.
        tree = tuple(
            node
            for one, comparison in zip(program.sets, program.chosen, strict=True)
            if one != HAND
            for node in _argument(one, comparison, values.__getitem__, self._logic, p)
        )
        return Explanation(self._version, labels, words, phi, p, tree)


def agent_logic(parameters: Mapping[str, Any]) -> Logic:
    """The logic that an agent acts by, from the parameters in its provenance.

    An agent that learns uses products, whose gradients reach every operand.
    """
    learns = parameters.get("learning", True)
    return PRODUCT if learns else logic_named(str(parameters["logic"]))


def explained(
    insight: Insight | None,
    observation: Observation,
    text: str,
    vocabulary: Vocabulary,
    stage: int = 0,
) -> tuple[Explanation | None, str]:
    """The explanation of a stage of a goal's text, or why it cannot be explained."""
    if insight is None:
        return None, "the agent's weights are not known here"
    try:
        programs = stages(parse_goal(text, vocabulary)) if text else (None,)
        return insight.explain(observation, programs[min(stage, len(programs) - 1)]), ""
    except PaError as error:
        return None, str(error).partition("\n")[0]


def _argument(
    expression: Expression, comparison: str, value: Any, logic: Logic, p: Float64
) -> Iterator[Node]:
    """The nodes of an argument; its comparison leaves the degrees of what it chooses."""
    if comparison:
        degrees = np.asarray(degree(expression, value, logic))
        yield Node(0, comparison, np.minimum(degrees, p))
    yield from _nodes(expression, value, logic, 1 if comparison else 0)


def _nodes(expression: Expression, value: Any, logic: Logic, depth: int = 0) -> Iterator[Node]:
    name = expression.name if isinstance(expression, Word) else type(expression).__name__.upper()
    yield Node(depth, name, np.asarray(degree(expression, value, logic)))
    match expression:
        case Not(operand):
            yield from _nodes(operand, value, logic, depth + 1)
        case And(operands) | Or(operands):
            for operand in operands:
                yield from _nodes(operand, value, logic, depth + 1)
