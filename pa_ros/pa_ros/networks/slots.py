"""Inputs of canonical networks: a slot for each kind of block, and the target as one-hots."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.language import And, Program, Vocabulary, Word
from pa_ros.networks.errors import NetworkError
from pa_ros.world.world import World


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
