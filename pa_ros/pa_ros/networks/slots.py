"""What canonical networks are told: a slot for each kind of block, the target as one-hots."""

from __future__ import annotations

import numpy as np

from pa_ros.core.errors import PaError
from pa_ros.core.experience import ARM_FEATURES, COLORS, OBJECT_FEATURES, SHAPES, Float32
from pa_ros.language import And, Program, Vocabulary, Word
from pa_ros.world.properties import truth_matrix


class UnsupportedProgramError(PaError):
    """A program that the canonical networks cannot be told."""

    code = "networks.unsupported_program"


def target_one_hots(program: Program, vocabulary: Vocabulary) -> Float32:
    """The target's shape and color as one-hots over the vocabulary, [V].

    Raises UnsupportedProgramError unless the program is an AND of one color and one shape.
    """
    words = program.words
    shapes = [word for word in words if word in vocabulary["shape"]]
    colors = [word for word in words if word in vocabulary["color"]]
    target = program.target
    flat = isinstance(target, And) and all(isinstance(part, Word) for part in target.operands)
    if not (flat and len(words) == 2 and len(shapes) == len(colors) == 1):
        raise UnsupportedProgramError(
            f"canonical networks: expected NEAR(HAND, AND(color, shape)), got {program}"
        )
    one_hots = np.zeros(len(vocabulary.words), np.float32)
    one_hots[[vocabulary.row[word] for word in words]] = 1.0
    return one_hots


def slot_matrices(vocabulary: Vocabulary) -> tuple[Float32, Float32]:
    """Two matrices [16, S]: an object fills slot s where `objects @ matrix` is 1 for both."""
    truth = truth_matrix(vocabulary)
    slots = slot_words(vocabulary)
    shapes = [vocabulary.row[shape] for shape, _ in slots]
    colors = [vocabulary.row[color] for _, color in slots]
    return truth[:, shapes], truth[:, colors]


def slot_words(vocabulary: Vocabulary) -> list[tuple[str, str]]:
    """(shape, color) of each block slot of the canonical networks' flattened Ω, in order."""
    shapes = [word for word in vocabulary["shape"] if word in SHAPES]
    colors = [word for word in vocabulary["color"] if word in COLORS]
    return [(shape, color) for shape in shapes for color in colors]


def canonical_inputs(vocabulary: Vocabulary) -> int:
    """Size of the canonical networks' input: hand, block slots, arm, target one-hots."""
    slots = 1 + len(slot_words(vocabulary))
    return slots * OBJECT_FEATURES + ARM_FEATURES + len(vocabulary.words)
