"""Messages to records and back: the only room that reads or writes message fields.

Each module holds the records of one subject with their `encode_…` and `decode_…` functions.
A `decode_…` checks everything that the graph could get wrong (sizes, finiteness, ranges), raises
`WireError` naming the field, and returns arrays that own their memory. An `encode_…` trusts its
record. Needs no rclpy.
"""

from __future__ import annotations

from typing import NewType

from pa_ros.core.errors import PaError

LONGEST = 200  # characters of a value that an error shows

Message = NewType("Message", object)
"""A ROS message outside this room: it can be passed on, but its fields have no names there."""


class WireError(PaError):
    """A message that differs from what its definition in msgs_schema promises.

    Codes: `wire.size`, `wire.non_finite`, `wire.range`, `wire.joint_names`,
    `wire.feature_names`, `wire.world`, `wire.reward`, `wire.arena_fact`, `wire.dtype`,
    `wire.truncated`, `wire.checksum`, `wire.version`, `wire.unknown_type`, `wire.encoding`,
    `wire.uncalibrated`, `program.id_taken`.
    """

    code = "wire"

    def __init__(self, field: str, expected: object, received: object, code: str) -> None:
        text = f"{field}: expected {_short(expected)}, received {_short(received)}"
        super().__init__(text, code)


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
