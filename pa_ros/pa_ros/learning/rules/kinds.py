"""The kinds of objects that programs name: one gather instead of evaluating programs anew."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32
from pa_ros.world.programs import ProgramTable, Sets, crisp, crisp_sets
from pa_ros.world.world import World


class Kinds:
    """All combinations of values that an object of a world can have, numbered. Where a
    camera sees blocks, only those of places."""

    def __init__(self, world: World) -> None:
        self._schema = world.schema
        values = {group.name: group.features.values for group in world.schema}
        rows = [world.schema.features(dict(zip(values, k, strict=True)))
                for k in product(*values.values())]  # fmt: skip
        # The hand is a kind of its own, the last one: it has no properties.
        hand = np.zeros(world.object_features, np.float32)
        self.features = np.stack([*rows, hand])  # [kinds + 1, F]; the last is the hand's
        self._truth = world.told(self.features).T  # [V, kinds + 1]
        self._sizes = [len(names) for names in values.values()]

    def of(self, objects: Float32) -> NDArray[np.intp]:
        """Kind of each object [..., F]; without meaning for the hand: [...]."""
        values = [has.argmax(-1) for has in self._schema.has(objects)]
        return np.asarray(np.ravel_multi_index(values, self._sizes))

    def named(self, table: ProgramTable) -> NDArray[np.bool_]:
        """Which kinds each program names, also to avoid them, [P, kinds + 1]."""
        named = crisp(table.compiled(), self._truth, self._truth.shape[1] - 1)
        return named | self.sets(table).avoided

    def sets(self, table: ProgramTable) -> Sets:
        """Which kinds are in each program's sets, [P, kinds + 1] each."""
        return crisp_sets(table.compiled(), self._truth, self._truth.shape[1] - 1)
