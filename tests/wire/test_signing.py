"""Signed messages: what is forged, altered, replayed or unsigned is refused, and by name."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import pytest

from benchmarks.samples import sample_step
from helpers import learners
from helpers.damage import damaged, explore
from helpers.learners import LEARNER, published
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.definitions import installed_types, message_type, to_cdr
from pa_ros.wire.learning import encode_learner_info, encode_trajectory, encode_weights
from pa_ros.wire.signing import (
    KEY_BYTES,
    SIGNED,
    WINDOW,
    Checker,
    Signer,
    SigningError,
    read_key,
)
from pa_ros.wire.step import encode_command

KEY, OTHER = b"k" * KEY_BYTES, b"o" * KEY_BYTES
MESSAGES = {
    "ArenaInfo": lambda: encode_arena_info(learners.ARENA),
    "LearnerInfo": lambda: encode_learner_info(LEARNER),
    "JointCommand": lambda: encode_command(sample_step()[2]),
    "Trajectory": lambda: encode_trajectory(learners.trajectory(0)),
    "PolicyWeights": lambda: encode_weights(published(1, 1)),
}


def sign(sender: Signer, name: str) -> Any:
    """A message of this type, signed."""
    return sender.sign(MESSAGES[name]())


def signer(incarnation: int = 1, key: bytes = KEY) -> Signer:
    return Signer(key, "/learner_node", incarnation)


def test_every_type_that_is_signed_is_tried():
    assert set(MESSAGES) == {kind.__name__ for kind in SIGNED}


@pytest.mark.parametrize("name", MESSAGES)
def test_what_is_signed_is_let_through_once(name):
    message, checker = signer().sign(MESSAGES[name]()), Checker(KEY)
    checker.check(message)
    with pytest.raises(SigningError, match="counter 1 of incarnation 1 again"):
        checker.check(message)


@pytest.mark.parametrize("name", MESSAGES)
def test_a_signature_survives_the_wire(name):
    """As bytes and back, by an independent implementation: arrays come as another type."""
    message, store = sign(signer(), name), installed_types()
    kind = message_type(type(message))
    again: Any = store.deserialize_cdr(to_cdr(store, message), kind)
    mark, read = message.signature[0], again.signature[0]
    for field in mark.get_fields_and_field_types():
        sent, came = getattr(mark, field), getattr(read, field)
        assert bytes(sent) == bytes(came) if field == "mac" else sent == came


@pytest.mark.parametrize("name", MESSAGES)
def test_another_key_and_none_are_refused(name):
    with pytest.raises(SigningError, match=f"{name}: expected a signature made"):
        Checker(KEY).check(signer(key=OTHER).sign(MESSAGES[name]()))
    with pytest.raises(SigningError, match=f"{name}: expected a signature, got none"):
        Checker(KEY).check(MESSAGES[name]())


@pytest.mark.parametrize("name", MESSAGES)
def test_whatever_is_altered_is_refused(name):
    checker = Checker(KEY)
    original = signer().sign(MESSAGES[name]())

    def check(altered: Any) -> None:
        if altered == original:
            return
        with pytest.raises(SigningError):
            checker.check(altered)

    explore(damaged(original), check, 100_000)
    checker.check(original)


def test_a_sender_that_began_again_makes_its_earlier_life_a_replay():
    checker, early = Checker(KEY), signer(1)
    checker.check(early.sign(MESSAGES["JointCommand"]()))
    checker.check(signer(2).sign(MESSAGES["JointCommand"]()))
    with pytest.raises(SigningError, match="incarnation 2"):
        checker.check(early.sign(MESSAGES["JointCommand"]()))
    other = Signer(KEY, "/other", 1)
    checker.check(other.sign(MESSAGES["JointCommand"]()))


def test_order_may_differ_within_a_window_and_nothing_counts_twice():
    checker, sender = Checker(KEY), signer()
    sent = [sender.sign(MESSAGES["JointCommand"]()) for _ in range(WINDOW + 6)]
    for index in (3, 1, 2, 0, 5):
        checker.check(sent[index])
    for index in (3, 1, 2, 0, 5):
        with pytest.raises(SigningError):
            checker.check(sent[index])
    checker.check(sent[4])
    checker.check(sent[-1])
    checker.check(sent[-2])
    with pytest.raises(SigningError):
        checker.check(sent[6 - 1])  # long past


def test_types_have_counters_of_their_own():
    """A late reader of a latched topic is told less than others were meanwhile."""
    checker, sender = Checker(KEY), signer()
    info = sender.sign(MESSAGES["LearnerInfo"]())
    for _ in range(2 * WINDOW):
        checker.check(sender.sign(MESSAGES["PolicyWeights"]()))
    checker.check(info)


def test_sign_covers_who_and_when():
    message = sign(signer(), "JointCommand")
    for change in ({"sender": "/a"}, {"incarnation": 9}, {"counter": 9}):
        altered = encode_command(dataclasses.replace(sample_step()[2]))
        mark = message.signature[0]
        altered.signature = [type(mark)(
            **{name: getattr(mark, name) for name in
               ("sender", "incarnation", "counter", "mac")} | change)]  # fmt: skip
        with pytest.raises(SigningError):
            Checker(KEY).check(altered)


def test_a_key_is_read_from_a_file_for_its_owner_alone(tmp_path: Path):
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    assert read_key(path) == KEY
    for mode in (0o640, 0o604, 0o666):
        path.chmod(mode)
        with pytest.raises(SigningError, match=f"{path}: expected a file that only.*{mode:o}"):
            read_key(path)
    path.chmod(0o600)
    path.write_bytes(b"short")
    with pytest.raises(SigningError, match="at least 32 bytes, got 5"):
        read_key(path)
    with pytest.raises(SigningError, match="nowhere"):
        read_key(tmp_path / "nowhere")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_user_of_this_host_cannot_read_the_key(tmp_path: Path):
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    for folder in (tmp_path, *tmp_path.parents):
        if folder.owner() == "root" and folder.name.startswith("pytest"):
            folder.chmod(0o755)
    child = os.fork()
    if child == 0:
        os.setgid(65534)
        os.setuid(65534)
        try:
            read_key(path)
        except SigningError as error:
            os._exit(0 if "Permission denied" in str(error) else 2)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
