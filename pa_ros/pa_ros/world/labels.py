"""What objects look like, in words for people."""

from __future__ import annotations

from pa_ros.core.experience import Float32
from pa_ros.world.schema import PAPER, ObjectSchema


def labels(objects: Float32, hand_index: int, schema: ObjectSchema = PAPER) -> tuple[str, ...]:
    """A name for each object of Ω, [N, F]: "hand", "RED CUBE", or "block 3" if nothing shows."""
    return tuple(
        "hand" if i == hand_index else _label(i, row, schema) for i, row in enumerate(objects)
    )


def _label(index: int, row: Float32, schema: ObjectSchema) -> str:
    shown = [
        value.upper()
        for group, has in zip(schema, schema.has(row), strict=True)
        for value, is_so in zip(group.features.values, has, strict=True)
        if is_so
    ]
    return " ".join(reversed(shown)) or f"block {index}"
