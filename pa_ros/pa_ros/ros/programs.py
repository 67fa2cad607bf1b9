"""Hearing programs from everyone: latched ones from before, and those of plain publishers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from pa_ros.ros.topics import PROGRAM, PROGRAM_LIVE
from pa_ros.wire import codec
from pa_ros.wire.records import ProgramRequest

REMEMBERED = 64


def subscribe_programs(
    node: Node,
    callback: Callable[[ProgramRequest], None],
    guard: Callable[[str, Callable[..., None]], Callable[..., None]],
) -> None:
    """Call back once per program published on `program`, late joiners included.

    A TRANSIENT_LOCAL reader hears latched programs and a VOLATILE one hears everyone, so there
    are two, and what both hear is told once, by its text, id and time of sending.
    """
    heard: deque[tuple[str, str, int]] = deque(maxlen=REMEMBERED)

    def receive(message: Any, info: Any) -> None:
        request = codec.decode_program(message)
        key = (request.program_id, request.text, info["source_timestamp"])
        if key not in heard:
            heard.append(key)
            callback(request)

    for topic in (PROGRAM, PROGRAM_LIVE):
        node.create_subscription(
            topic.type, topic.name, _two_arguments(guard("program", receive)), topic.reader
        )


def _two_arguments(callback: Callable[..., None]) -> Callable[[Any, Any], None]:
    """rclpy looks at the signature to see whether a callback takes the message's info."""

    def with_info(message: Any, info: Any) -> None:
        callback(message, info)

    return with_info
