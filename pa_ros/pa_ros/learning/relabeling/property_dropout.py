"""Property dropout: at times a block of a sampled transition shows no shape, no color, or neither.

Not in the paper. What a word means of a block that shows none of the properties that training has
is left open by training: the detectors then say whatever their biases say, which is that such a
block is as likely RED as not. Blocks that a drawn program names keep their properties, so rewards
stay as they are, and the others must be passed by whatever they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import COLORS, OBJECT_FEATURES, SHAPES, Float32
from pa_ros.core.update import HAND_INDEX
from pa_ros.world.programs import ProgramTable, crisp
from pa_ros.world.properties import COLOR, SHAPE, truth_matrix


class PropertyDropout:
    """Hides properties of blocks that none of a table's programs in a batch names."""

    def __init__(self, table: ProgramTable, probability: float) -> None:
        self._table = table
        self._probability = probability
        self._named: NDArray[np.bool_] = np.zeros((0, 0), np.bool_)
        kinds = np.zeros((len(SHAPES) * len(COLORS) + 1, OBJECT_FEATURES), np.float32)
        for kind in range(len(kinds) - 1):  # the last is the hand
            shape, color = divmod(kind, len(COLORS))
            kinds[kind, [SHAPE.start + shape, COLOR.start + color]] = 1.0
        self._truth = (kinds @ truth_matrix(table.vocabulary)).T  # [V, kinds + 1]

    def hide(
        self, drawn: Float32, objects: Float32, following: Float32, program: NDArray[np.int32]
    ) -> None:
        """Clear one-hots of at most one block of each transition, before and after it, in place.

        `drawn` is [B, 2] of [0, 1): which properties, if any, and of which block. `objects` and
        `following` are [B, N, 16], `program` is [B, K], rows of the table.
        """
        free = ~self._names(objects, program)
        free[:, HAND_INDEX] = False
        count = free.sum(1)
        block = (free.cumsum(1) > (drawn[:, 1] * count).astype(np.int64)[:, None]).argmax(1)
        part = np.where(count > 0, drawn[:, 0] / self._probability, 1.0)  # 1 and more: nothing
        for hidden, columns in ((part < 2 / 3, SHAPE), ((part >= 1 / 3) & (part < 1), COLOR)):
            rows = np.flatnonzero(hidden)
            objects[rows, block[rows], columns] = 0.0
            following[rows, block[rows], columns] = 0.0

    def _names(self, objects: Float32, program: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Blocks that one of a transition's programs names, [B, N]."""
        if len(self._named) != len(self._table):
            self._named = crisp(self._table.arrays(), self._truth, self._truth.shape[1] - 1)
        shape, color = objects[..., SHAPE].argmax(-1), objects[..., COLOR].argmax(-1)
        kind = shape * len(COLORS) + color  # [B, N]
        named: NDArray[np.bool_] = self._named[program[:, :, None], kind[:, None]].any(1)
        return named
