"""What a process says about itself: health and provenance as messages."""

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.messages import texts
from helpers.rejections import rejected
from helpers.worlds import PROGRAMS, WORLD
from pa_ros.wire.diagnostics import (
    Health,
    LearnerOrigin,
    Origin,
    decode_diagnostics,
    decode_provenance,
    encode_diagnostics,
    encode_provenance,
)

ORIGIN = Origin(
    node="/arena1/learner_node",
    instance="run",
    software_version="0.1.0",
    versions="python 3.11",
    seed=2**63,
    parameters={"recipe": "ours", "learner.replay.batch_size": 16, "resume": False},
    design="2-L",
    arm="jaco",
    preset="fast",
    world=WORLD,
    stamp_ns=1_234_567_890_123_456_789,
    learner=LearnerOrigin(7, '{"hidden":150}', '{"batch_size":64}', "td3", PROGRAMS),
)
health = st.builds(
    Health, texts, st.integers(0, 3), texts, st.dictionaries(texts, texts, max_size=3)
)


@given(st.lists(health, max_size=3))
def test_diagnostics_survive_the_wire(entries):
    assert decode_diagnostics(encode_diagnostics(entries, 3)) == entries


@pytest.mark.parametrize("origin", [ORIGIN, replace(ORIGIN, learner=None, world=None)])
def test_provenance_survives_the_wire(origin):
    message = encode_provenance(origin)
    assert decode_provenance(message) == origin
    assert [*json.loads(message.parameters)] == ["learner.replay.batch_size", "recipe", "resume"]


@pytest.mark.parametrize(
    ("field", "value", "code"),
    [
        ("wire_version", "0", "wire.version"),
        ("parameters", "[1, 2]", "wire.range"),
        ("world", "", "wire.range"),
        ("world_digest", "0" * 16, "wire.world"),
    ],
)
def test_malformed_provenance_is_rejected(field, value, code):
    message = encode_provenance(ORIGIN)
    setattr(message, field, value)
    with rejected(code, match=f"provenance.{field}"):
        decode_provenance(message)
