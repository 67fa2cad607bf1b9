"""Provenance: decode∘encode, and what the door refuses."""

import dataclasses

import pytest

from pa_ros.language import Vocabulary, parse
from pa_ros.wire.diagnostics import LearnerOrigin, Origin, decode_provenance, encode_provenance
from pa_ros.wire.errors import WireError
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=("CUBE", "SPHERE"), color=("RED", "BLUE"))
WORLD = World(PAPER, WORDS, joints=6)

ORIGIN = Origin(
    node="/arena1/learner_node",
    instance="run",
    software_version="0.1.0",
    versions="python 3.11",
    seed=2**63,
    parameters={"protocol": "ours", "learner.replay.batch_size": 16, "resume": False},
    design="2-L",
    arm="jaco",
    preset="fast",
    world=WORLD,
    stamp_ns=1_234_567_890_123_456_789,
    learner=LearnerOrigin(
        7,
        '{"hidden":150}',
        '{"batch_size":64}',
        "td3",
        (parse("NEAR(HAND, RED)", WORDS),),
    ),
)


@pytest.mark.parametrize("origin", [ORIGIN, dataclasses.replace(ORIGIN, learner=None, world=None)])
def test_what_is_decoded_is_what_was_encoded(origin):
    assert decode_provenance(encode_provenance(origin)) == origin


def test_another_edition_and_parameters_that_are_not_an_object_are_refused():
    message = encode_provenance(ORIGIN)
    message.parameters = "[1, 2]"
    with pytest.raises(WireError, match="JSON object"):
        decode_provenance(message)
    message.wire_version = "0"
    with pytest.raises(WireError, match="received 0"):
        decode_provenance(message)
