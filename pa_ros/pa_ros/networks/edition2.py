"""Descriptions of networks by version 0.2, which knew one world: the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pa_ros.language.vocabulary import Vocabulary
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

_SIZES = {"object_features": 16, "arm_features": 18, "actions": 6}


def with_world(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a network or an architecture as they are now said, whichever version said them.

    KeyError, TypeError or ValueError for values of neither.
    """
    if "world" in values:
        return dict(values)
    for name, size in _SIZES.items():
        if values.get(name, size) != size:
            raise ValueError(f"{name}: expected {size}, got {values[name]!r}")
    words = Vocabulary.of(shape=tuple(values["shapes"]), color=tuple(values["colors"]))
    kept = {k: v for k, v in values.items() if k not in (*_SIZES, "shapes", "colors")}
    return kept | {"world": World(PAPER, words, joints=6).to_data()}
