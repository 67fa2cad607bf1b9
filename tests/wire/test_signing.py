"""Signed messages: forged, altered, replayed and unsigned ones are rejected."""

from pathlib import Path
from typing import Any

import pytest

from helpers import learners
from helpers.damage import damaged, explore
from helpers.rejections import rejected
from laboratory.benchmarks.samples import sample_step
from pa_ros.core.errors import PaError
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_learner_info, encode_trajectory, encode_weights
from pa_ros.wire.signing import KEY_BYTES, SIGNED, WINDOW, Checker, Signer, read_key
from pa_ros.wire.step import encode_command, encode_step

KEY, OTHER_KEY = b"k" * KEY_BYTES, b"o" * KEY_BYTES
TOPIC = "/arena1/topic"
MESSAGES = {
    "ArenaInfo": lambda: encode_arena_info(learners.ARENA),
    "LearnerInfo": lambda: encode_learner_info(learners.LEARNER),
    "ObjectFeatures": lambda: encode_step(sample_step()[0]),
    "JointCommand": lambda: encode_command(sample_step()[1]),
    "Trajectory": lambda: encode_trajectory(learners.trajectory(0)),
    "PolicyWeights": lambda: encode_weights(learners.published(1, 1)),
}


def signer(incarnation: int = 1, key: bytes = KEY) -> Signer:
    return Signer(key, "/learner_node", incarnation)


def signed(sender: Signer, name: str = "JointCommand") -> Any:
    return sender.sign(TOPIC, MESSAGES[name]())


def test_every_signed_type_is_tested_here():
    assert set(MESSAGES) == {kind.__name__ for kind in SIGNED}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_signed_message_is_accepted_once(name):
    message, checker = signed(signer(), name), Checker(KEY)
    checker.check(TOPIC, message)
    with rejected("auth.replayed", match="counter 1 of incarnation 1 again$"):
        checker.check(TOPIC, message)


@pytest.mark.parametrize("name", MESSAGES)
def test_another_key_or_no_signature_is_rejected(name):
    with rejected("auth.forged", match=f"{TOPIC}: expected a signature made"):
        Checker(KEY).check(TOPIC, signed(signer(key=OTHER_KEY), name))
    with rejected("auth.unsigned", match=f"{TOPIC}: expected a signature, got none"):
        Checker(KEY).check(TOPIC, MESSAGES[name]())


@pytest.mark.parametrize("name", MESSAGES)
def test_any_altered_field_is_rejected(name):
    checker, original = Checker(KEY), signed(signer(), name)

    def check(altered: Any) -> None:
        if altered != original:
            with pytest.raises(PaError):
                checker.check(TOPIC, altered)

    explore(damaged(original), check, 100_000)
    checker.check(TOPIC, original)


def test_a_restarted_sender_makes_its_earlier_messages_replays():
    checker, early = Checker(KEY), signer(1)
    for _ in range(3):
        checker.check(TOPIC, signed(early))
    checker.check(TOPIC, signed(signer(2)))
    with rejected("auth.replayed", match="incarnation 2.*clock was set back.*restart this node"):
        checker.check(TOPIC, signed(early))
    checker.check(TOPIC, signed(Signer(KEY, "/other", 1)))


def test_messages_may_arrive_out_of_order_within_a_window():
    checker, sender = Checker(KEY), signer()
    sent = [signed(sender) for _ in range(WINDOW + 6)]
    for index in (3, 1, 2, 0, 5):
        checker.check(TOPIC, sent[index])
        with rejected("auth.replayed"):
            checker.check(TOPIC, sent[index])
    for index in (4, -1, -2, 6):
        checker.check(TOPIC, sent[index])
    for index in (5, 6, -2):  # the first of them is before the window
        with rejected("auth.replayed"):
            checker.check(TOPIC, sent[index])


def test_each_topic_has_its_own_counter():
    """So a late subscriber of a latched topic accepts a message older than those of others."""
    checker, sender = Checker(KEY), signer()
    info = signed(sender, "LearnerInfo")
    for _ in range(2 * WINDOW):
        checker.check("/commands", sender.sign("/commands", MESSAGES["JointCommand"]()))
    checker.check(TOPIC, info)


def test_a_message_of_another_namespace_is_rejected():
    with rejected("auth.forged", match="/arena2/topic: expected a signature made .* this topic"):
        Checker(KEY).check("/arena2/topic", signed(signer()))


def test_what_a_message_says_cannot_be_shifted_between_its_fields():
    message = signed(signer(), "ArenaInfo")
    message.training_programs = [*message.training_programs, message.object_feature_names[0]]
    message.object_feature_names = message.object_feature_names[1:]
    with rejected("auth.forged"):
        Checker(KEY).check(TOPIC, message)


def test_a_key_file_must_be_private_and_long_enough(tmp_path: Path):
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    assert read_key(path) == KEY
    for mode in (0o640, 0o604):
        path.chmod(mode)
        with rejected("auth.key_file", match=f"{path}: expected a file that only.*{mode:o}"):
            read_key(path)
    path.chmod(0o600)
    path.write_bytes(b"short")
    with rejected("auth.key_file", match="at least 32 bytes, got 5"):
        read_key(path)
    with rejected("auth.key_file", match="nowhere"):
        read_key(tmp_path / "nowhere")
