"""Messages to records and back: the only room that reads or writes message fields.

Each module holds the records of one subject with their `encode_…` and `decode_…` functions.
A `decode_…` checks everything that the graph could get wrong (sizes, finiteness, ranges), raises
`WireError` naming the field, and returns arrays that own their memory. An `encode_…` trusts its
record. Needs no rclpy.
"""

from __future__ import annotations

from typing import NewType

Message = NewType("Message", object)
"""A ROS message outside this room: it can be passed on, but its fields have no names there."""
