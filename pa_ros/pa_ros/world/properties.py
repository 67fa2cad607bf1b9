"""Where the true properties lie in an object's features."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import COLORS, OBJECT_FEATURES, SHAPES, Float32
from pa_ros.language.vocabulary import Vocabulary

COLOR = slice(OBJECT_FEATURES - len(COLORS), OBJECT_FEATURES)  # one-hot of Ω, and of ω
SHAPE = slice(COLOR.start - len(SHAPES), COLOR.start)
PROPERTIES = slice(SHAPE.start, COLOR.stop)  # both


def truth_matrix(vocabulary: Vocabulary) -> Float32:
    """[16, V]: `objects @ truth_matrix` is the true Φ, transposed (words of nothing: zero)."""
    matrix = np.zeros((OBJECT_FEATURES, len(vocabulary.words)), np.float32)
    for offset, (named, words) in zip(
        (SHAPE.start, COLOR.start),
        ((SHAPES, vocabulary["shape"]), (COLORS, vocabulary["color"])),
        strict=True,
    ):
        for word in words:
            if word in named:
                matrix[offset + named.index(word), vocabulary.row[word]] = 1.0
    return matrix
