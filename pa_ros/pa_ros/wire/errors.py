"""The error of this room: a rejected message, named by its field."""

from __future__ import annotations

from pa_ros.core.errors import PaError

LONGEST = 200  # characters of a value shown


class WireError(PaError):
    """A message that differs from what its definition in msgs_schema promises.

    Codes: `wire.size`, `wire.non_finite`, `wire.range`, `wire.joint_names`, `wire.stamp`,
    `wire.feature_names`, `wire.world`, `wire.reward`, `wire.arena_fact`, `wire.dtype`,
    `wire.truncated`, `wire.checksum`, `wire.version`, `wire.unknown_type`, `program.id_taken`.
    """

    code = "wire"

    def __init__(self, field: str, expected: object, received: object, code: str) -> None:
        text = f"{field}: expected {_short(expected)}, received {_short(received)}"
        super().__init__(text, code)


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
