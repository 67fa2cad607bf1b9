"""Only `pa_ros.wire` reads and writes fields of messages; all others call its functions."""

from pathlib import Path

import pytest

from helpers.sources import accesses, files

PLANTED = {
    "a parameter": "def f(message: Any):\n    return message.agent_id",
    "written": "def f(message: Any):\n    message.step = 3",
    "by name": "def f(message: Any):\n    return getattr(message, 'step')",
    "just encoded": "def f(policy):\n    print(encode_weights(policy).checksum)",
    "encoded before": "def f(step):\n    m = encode_verdict(step)\n    m.reward = 1.0",
    "from a bag": "def f(bag):\n    print(bag.deserialize(recorded).step)",
    "beside its decoder": "def f(v: Any):\n    x = decode_step(v)\n    return v.reward",
    "taken by hand": "def f():\n    taken = s.take_message(kind, False)\n    print(taken[0].step)",
}
HARMLESS = {
    "a record": "def f(message: Message):\n    return decode_step(message).verdict.reward",
    "text": "def f(log):\n    return log.read().decode().splitlines()",
    "a request of ours": "def f(request: ProgramRequest):\n    return request.text",
}
OUTSIDE = [(module, path) for module, path in files() if not module.startswith("pa_ros.wire")]


@pytest.mark.parametrize("source", PLANTED.values(), ids=PLANTED)
def test_a_planted_access_is_found(source: str):
    assert accesses(source)


@pytest.mark.parametrize("source", HARMLESS.values(), ids=HARMLESS)
def test_harmless_code_passes(source: str):
    assert accesses(source) == []


@pytest.mark.parametrize(("module", "path"), OUTSIDE, ids=[module for module, _ in OUTSIDE])
def test_only_the_wire_touches_message_fields(module: str, path: Path):
    assert accesses(path.read_text()) == []
