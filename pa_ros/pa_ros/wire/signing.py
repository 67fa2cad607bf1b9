"""Messages signed with a key that all nodes of a graph share.

The signature (an HMAC) covers the type, the sender (name and incarnation), a counter, and every
other field. The counter rejects a copy of a message; the incarnation rejects one from an earlier
start of its sender. Messages may arrive out of order within a window, as in IPsec (RFC 4303,
3.4.3). Limits: a receiver that has just started remembers no counters, so its first messages may
be a recording; and everyone who has the key can sign in any name.
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

from msgs_schema import msg
from pa_ros.core.errors import PaError
from pa_ros.wire import Message

SIGNED: Final = (
    msg.ArenaInfo,
    msg.LearnerInfo,
    msg.JointCommand,
    msg.Trajectory,
    msg.PolicyWeights,
)
KEY_BYTES: Final = 32  # least length of a key
WINDOW: Final = 64  # how many counters a message may arrive late
_FIELD: Final = "signature"


class SigningError(PaError):
    """A key file that cannot be used, or a message without a valid signature.

    Codes: `auth.key_file`, `auth.unsigned`, `auth.forged`, `auth.replayed`.
    """

    code = "auth"


def read_key(path: Path) -> bytes:
    """Return the key in a file that only its owner can read. Raises SigningError.

    `head -c 32 /dev/urandom > FILE` makes one.
    """
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            key = file.read(4096)
    except OSError as error:
        raise SigningError(f"auth_key_file: {error}", code="auth.key_file") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        text = f"expected a file that only its owner can read (mode 600), got mode {mode:o}"
        raise SigningError(f"auth_key_file: {path}: {text}", code="auth.key_file")
    if len(key) < KEY_BYTES:
        text = f"expected at least {KEY_BYTES} bytes, got {len(key)}"
        raise SigningError(f"auth_key_file: {path}: {text}", code="auth.key_file")
    return key


class Signer:
    """Signs the messages of one process."""

    def __init__(self, key: bytes, sender: str, incarnation: int) -> None:
        self._key, self._sender, self._incarnation = key, sender, incarnation
        self._counters: dict[type, int] = {}

    def sign(self, message: Message) -> Message:
        """Sign a message in place and return it. A message sent again gets a new signature."""
        signed: Any = message
        kind = type(message)
        self._counters[kind] = self._counters.get(kind, 0) + 1
        mark = msg.Signature(
            sender=self._sender, incarnation=self._incarnation, counter=self._counters[kind]
        )
        signed.signature = [mark]
        mark.mac = _mac(self._key, signed)
        return message


class Checker:
    """Accepts each message that is signed with the key, once."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._received: dict[tuple[type, str], _Received] = {}

    def check(self, message: Message) -> None:
        """Raise SigningError if the message must not be used."""
        signed: Any = message
        kind = type(message)
        name = kind.__name__
        if not signed.signature:
            raise SigningError(f"{name}: expected a signature, got none", code="auth.unsigned")
        mark = signed.signature[0]
        if not hmac.compare_digest(bytes(mark.mac), _mac(self._key, signed)):
            text = "expected a signature made with this graph's key, got another from a sender "
            text += f"that calls itself {mark.sender[:100]!r}"
            raise SigningError(f"{name}: {text}", code="auth.forged")
        received = self._received.setdefault((kind, mark.sender), _Received(mark.incarnation))
        if not received.accept(mark.incarnation, mark.counter):
            text = f"expected a new message of {mark.sender!r} (incarnation "
            text += f"{received.incarnation}, counter above {received.highest}), got counter "
            text += f"{mark.counter} of incarnation {mark.incarnation} again"
            raise SigningError(f"{name}: {text}", code="auth.replayed")


@dataclass
class _Received:
    """Counters received from one sender for one type; bit i of `seen` stands for highest - i."""

    incarnation: int
    highest: int = 0
    seen: int = 0

    def accept(self, incarnation: int, counter: int) -> bool:
        """Mark a counter as received; return whether it was new."""
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
        # The length in front keeps two neighbouring fields from being shifted into one another.
        made.update(len(part).to_bytes(8, "little"))
        made.update(part)
    return made.digest()


def _contents(value: Any) -> Iterator[bytes]:
    """Yield every field's value, in order, except the signature; floats to the last bit."""
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
