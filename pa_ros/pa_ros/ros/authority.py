"""What a node signs and checks, where it is given a key: one place for all nodes."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.node import Node

from pa_ros.core.authentication import Authenticated
from pa_ros.ros.topics import Topic
from pa_ros.wire import Message
from pa_ros.wire.signing import SIGNED, Checker, Signer, read_key


class Authority:
    """Without a key it lets everything through."""

    def __init__(self, node: Node, config: Authenticated) -> None:
        """Raises SigningError."""
        self._node = node
        self._signer: Signer | None = None
        self._checker: Checker | None = None
        if config.auth_key_file:
            key = read_key(Path(config.auth_key_file))
            self._signer = Signer(key, node.get_fully_qualified_name(), time.time_ns())
            self._checker = Checker(key)

    def publisher(self, topic: Topic) -> Any:
        """What the node publishes with; signs messages of the types that are signed."""
        plain = topic.publisher(self._node)
        if self._signer is None or topic.type not in SIGNED:
            return plain
        return _Signing(plain, self._signer)

    def checked(
        self, topic: Topic, callback: Callable[[Message], None]
    ) -> Callable[[Message], None]:
        """The callback, for messages that may be heard; of others it raises SigningError."""
        checker = self._checker
        if checker is None or topic.type not in SIGNED:
            return callback

        def check_first(message: Message) -> None:
            checker.check(message)
            callback(message)

        return check_first


class _Signing:
    """A publisher that signs."""

    def __init__(self, plain: Any, signer: Signer) -> None:
        self._plain, self._signer = plain, signer

    def publish(self, message: Message) -> None:
        self._plain.publish(self._signer.sign(message))

    def get_subscription_count(self) -> int:
        return int(self._plain.get_subscription_count())
