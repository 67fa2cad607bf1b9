"""Messages signed with a key that all nodes of a graph share.

The signature (an HMAC) covers the topic's full name, the type, the sender (name and incarnation), a
counter, and every other field. The name keeps a message from being carried to another arena's
namespace. The counter rejects a copy of a message; the incarnation rejects one from an earlier
start of its sender. Messages may arrive out of order within a window, as in IPsec (RFC 4303,
3.4.3). Limits: a receiver that has just started remembers no counters, so its first messages may
be a recording; and everyone who has the key can sign in any name.
"""

from __future__ import annotations

import array
import hmac
import stat
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from msgs_schema import msg
from pa_ros.core.errors import PaError
from pa_ros.wire import Message

SIGNED: Final = tuple(kind for kind in vars(msg).values() if hasattr(kind, "signature"))
KEY_BYTES: Final = 32  # least length of a key
WINDOW: Final = 64  # how many counters a message may arrive late
_SEEN: Final = (1 << WINDOW) - 1  # a bit for each of them
_FIELD: Final = "signature"
Read = Callable[[Any], Any]  # reads a field of a message


def read_key(path: Path) -> bytes:
    """The key in a file that only its owner can read. Raises PaError
    (`auth.key_file`).

    `head -c 32 /dev/urandom > FILE` makes one.
    """
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        key = path.read_bytes()
    except OSError as error:
        raise PaError(f"auth_key_file: {error}", code="auth.key_file") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        text = f"expected a file that only its owner can read (mode 600), got mode {mode:o}"
        raise PaError(f"auth_key_file: {path}: {text}", code="auth.key_file")
    if len(key) < KEY_BYTES:
        text = f"expected at least {KEY_BYTES} bytes, got {len(key)}"
        raise PaError(f"auth_key_file: {path}: {text}", code="auth.key_file")
    return key


class Signer:
    """Signs the messages of one process."""

    def __init__(self, key: bytes, sender: str, incarnation: int) -> None:
        self._key, self._sender, self._incarnation = key, sender, incarnation
        self._counters: dict[str, int] = {}  # by topic

    def sign(self, topic: str, message: Message) -> Message:
        """Sign a message in place and return it. A message sent again gets a new signature.

        :param topic: full name of the topic on which it is sent.
        """
        signed: Any = message
        if not signed.signature:
            signed.signature = [msg.Signature(sender=self._sender, incarnation=self._incarnation)]
        mark = signed.signature[0]
        mark.counter = self._counters[topic] = self._counters.get(topic, 0) + 1
        mark.mac = array.array("B", _mac(self._key, topic, signed))
        return message


class Checker:
    """Accepts each message that is signed with the key, once."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._received: dict[tuple[str, str], _Received] = {}  # by topic and sender

    def check(self, topic: str, message: Message) -> None:
        """Raise PaError (`auth.unsigned`, `auth.forged`, `auth.replayed`) if a message that arrived
        on a topic must not be used."""
        signed: Any = message
        if not signed.signature:
            raise PaError(f"{topic}: expected a signature, got none", code="auth.unsigned")
        mark = signed.signature[0]
        if not hmac.compare_digest(mark.mac.tobytes(), _mac(self._key, topic, signed)):
            text = "expected a signature made with this graph's key, for this topic, got another "
            text += f"from a sender that calls itself {mark.sender[:100]!r}"
            raise PaError(f"{topic}: {text}", code="auth.forged")
        received = self._received.get((topic, mark.sender))
        if received is None or received.incarnation < mark.incarnation:
            received = self._received[topic, mark.sender] = _Received(mark.incarnation)
        if not received.accept(mark.incarnation, mark.counter):
            text = f"expected a new message of {mark.sender!r} (incarnation "
            text += f"{received.incarnation}, counter above {received.highest}), got counter "
            text += f"{mark.counter} of incarnation {mark.incarnation} again"
            if mark.incarnation < received.incarnation:
                text += "; if its machine's clock was set back before it started, restart this node"
            raise PaError(f"{topic}: {text}", code="auth.replayed")


@dataclass
class _Received:
    """Counters received on one topic from one start of a sender; bit i of `seen` stands for
    highest - i."""

    incarnation: int
    highest: int = 0
    seen: int = 0

    def accept(self, incarnation: int, counter: int) -> bool:
        """Mark a counter as received; return whether it was new."""
        if incarnation < self.incarnation:
            return False
        if counter > self.highest:
            ahead = min(counter - self.highest, WINDOW)
            self.seen = (self.seen << ahead | 1) & _SEEN
            self.highest = counter
            return True
        behind = self.highest - counter
        if behind >= WINDOW or self.seen >> behind & 1:
            return False
        self.seen |= 1 << behind
        return True


def _mac(key: bytes, topic: str, signed: Any) -> bytes:
    mark, arrays = signed.signature[0], list[bytes]()
    about = topic, signed.__class__.__name__, mark.sender, mark.incarnation, mark.counter
    # The text contains the arrays' sizes, so that nothing can be shifted from one into another.
    text = repr((about, _values(signed, arrays), [len(one) for one in arrays]))
    return hmac.digest(key, b"".join([text.encode(), *arrays]), "sha256")


def _values(message: Any, arrays: list[bytes]) -> tuple[Any, Any]:
    """All fields but the signature; the bytes of arrays are appended to `arrays`."""
    single, numeric, lists = _fields(message.__class__)
    arrays += [read(message).tobytes() for read in numeric]
    return single(message), [
        [one if isinstance(one, str) else _values(one, arrays) for one in read(message)]
        for read in lists
    ]


@cache
def _fields(kind: Any) -> tuple[Read, list[Read], list[Read]]:
    """Sort the fields of a type, and of messages in it: single values, arrays of numbers, lists."""
    single, numeric, lists = list[str](), list[str](), list[str]()

    def sort(message: Any, within: str) -> None:
        for name in message.get_fields_and_field_types():
            value, path = getattr(message, name), within + name
            if hasattr(value, "get_fields_and_field_types"):
                sort(value, f"{path}.")
            elif path != _FIELD:
                numbers = hasattr(value, "tobytes")
                (numeric if numbers else lists if isinstance(value, list) else single).append(path)

    sort(kind(), "")
    return attrgetter(*single), list(map(attrgetter, numeric)), list(map(attrgetter, lists))
