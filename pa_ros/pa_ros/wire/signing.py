"""Who may speak: messages signed with a key that all nodes of a graph share.

The MAC covers the type, who sends (name and incarnation), a counter, and every other field. A copy
of a message is refused by its counter, one of an earlier life of its sender by its incarnation;
order may differ within a window, as in IPsec (RFC 4303, 3.4.3). What a receiver that has just
started is told first may be a recording, since it remembers nothing; and whoever has the key may
sign as anyone.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pa_ros.core.errors import PaError
from pa_ros.wire import interfaces as types
from pa_ros.wire.interfaces import Message

SIGNED: Final = (
    types.ArenaInfo,
    types.LearnerInfo,
    types.JointCommand,
    types.Trajectory,
    types.PolicyWeights,
)
KEY_BYTES: Final = 32  # at least so many
WINDOW: Final = 64  # messages that may be overtaken
_FIELD: Final = "signature"


class KeyFileError(PaError):
    """A key file that cannot be read, is too short, or that others can read."""

    code = "auth.key_file"


class SignatureError(PaError):
    """A message of somebody who may not speak. Root of these."""

    code = "auth"


class UnsignedError(SignatureError):
    """No signature, where this node was given a key."""

    code = "auth.unsigned"


class ForgedError(SignatureError):
    """Another key's signature, or other contents than were signed."""

    code = "auth.forged"


class ReplayedError(SignatureError):
    """A message that was heard before, or of an earlier life of its sender."""

    code = "auth.replayed"


def read_key(path: Path) -> bytes:
    """The key in a file that its owner alone can read: `head -c 32 /dev/urandom` makes one.

    Raises KeyFileError.
    """
    try:
        with path.open("rb") as file:
            about = os.fstat(file.fileno())
            key = file.read(4096)
    except OSError as error:
        raise KeyFileError(f"auth_key_file: {error}") from error
    if about.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        mode = stat.S_IMODE(about.st_mode)
        raise KeyFileError(
            f"auth_key_file: {path}: expected a file for its owner alone (mode 600), got {mode:o}"
        )
    if len(key) < KEY_BYTES:
        raise KeyFileError(
            f"auth_key_file: {path}: expected at least {KEY_BYTES} bytes, got {len(key)}"
        )
    return key


class Signer:
    """Signs what one process sends."""

    def __init__(self, key: bytes, sender: str, incarnation: int) -> None:
        self._key, self._sender, self._incarnation = key, sender, incarnation
        self._counters: dict[type, int] = {}

    def sign(self, message: Message) -> Message:
        """The same message, signed; a message that is sent again is signed again."""
        signed: Any = message
        kind = type(message)
        self._counters[kind] = self._counters.get(kind, 0) + 1
        mark = types.Signature(
            sender=self._sender, incarnation=self._incarnation, counter=self._counters[kind]
        )
        signed.signature = [mark]
        mark.mac = _mac(self._key, signed)
        return message


class Checker:
    """Lets through what is signed with the key, once."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._heard: dict[tuple[type, str], _Heard] = {}

    def check(self, message: Message) -> None:
        """Raise UnsignedError, ForgedError or ReplayedError; then the message is not to be used."""
        signed: Any = message
        kind = type(message)
        name = kind.__name__
        if not signed.signature:
            raise UnsignedError(f"{name}: expected a signature, got none")
        mark = signed.signature[0]
        if not hmac.compare_digest(bytes(mark.mac), _mac(self._key, signed)):
            raise ForgedError(
                f"{name}: expected contents signed with this graph's key, got others in the name "
                f"of {mark.sender[:100]!r}"
            )
        heard = self._heard.setdefault((kind, mark.sender), _Heard(mark.incarnation))
        if not heard.take(mark.incarnation, mark.counter):
            raise ReplayedError(
                f"{name}: expected news of {mark.sender!r} (incarnation {heard.incarnation}, "
                f"beyond {heard.highest}), got number {mark.counter} of {mark.incarnation} again"
            )


@dataclass
class _Heard:
    """Counters of one sender and type that were taken; `seen` has a bit for each of the newest."""

    incarnation: int
    highest: int = 0
    seen: int = 0

    def take(self, incarnation: int, counter: int) -> bool:
        """Whether it is new; it is then old."""
        if incarnation < self.incarnation:
            return False
        if incarnation > self.incarnation:
            self.incarnation, self.highest, self.seen = incarnation, 0, 0
        if counter > self.highest:
            ahead = min(counter - self.highest, WINDOW)
            self.seen = (self.seen << ahead | 1) & ((1 << WINDOW) - 1)
            self.highest = counter
            return True
        behind = self.highest - counter
        if behind >= WINDOW or self.seen >> behind & 1:
            return False
        self.seen |= 1 << behind
        return True


def _mac(key: bytes, signed: Any) -> bytes:
    mark = signed.signature[0]
    made = hmac.new(key, digestmod=hashlib.sha256)
    about = f"{type(signed).__name__}\0{mark.sender}\0{mark.incarnation}\0{mark.counter}"
    for part in (about.encode(), *_contents(signed)):
        made.update(len(part).to_bytes(8, "little"))
        made.update(part)
    return made.digest()


def _contents(value: Any) -> Iterator[bytes]:
    """Every field's value, in order, but the signature; floats to the last bit."""
    for name in value.get_fields_and_field_types():
        if name != _FIELD:
            yield from _parts(getattr(value, name))


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, (bool, int, float)):
        yield repr(value).encode()
    elif isinstance(value, str):
        yield value.encode()
    elif isinstance(value, list):
        yield str(len(value)).encode()
        for item in value:
            yield from _parts(item)
    elif hasattr(value, "tobytes"):
        yield value.tobytes()
    elif isinstance(value, bytes):
        yield value
    else:
        yield from _contents(value)
