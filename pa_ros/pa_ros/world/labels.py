"""What objects look like, in words for people."""

from __future__ import annotations

from pa_ros.core.experience import Float32
from pa_ros.world.schema import PAPER, ObjectSchema

POSE_FEATURES = 7  # of Ω's columns; properties follow


def labels(objects: Float32, hand_index: int, schema: ObjectSchema = PAPER) -> tuple[str, ...]:
    """A name for each object of Ω, [N, F]: "hand", "RED CUBE", or "block 3" if nothing shows."""
    return tuple(
        "hand" if i == hand_index else _label(i, row, schema) for i, row in enumerate(objects)
    )


def _label(index: int, row: Float32, schema: ObjectSchema) -> str:
    named = zip(schema.feature_names[POSE_FEATURES:], row[POSE_FEATURES:].tolist(), strict=True)
    shown = [name.partition("_")[2].upper() for name, value in named if value > 0.5]
    return " ".join(reversed(shown)) or f"block {index}"
