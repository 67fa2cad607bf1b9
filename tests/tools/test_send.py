"""A program where no agent takes goals: it is published, and the arena's steps are watched."""

from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from helpers.messages import judged
from pa_ros.tools import send
from pa_ros.tools.client import NoAnswerError

PATIENCE_S = 3.0


def test_patience_ends_when_no_step_arrives_however_long_the_program_takes(monkeypatch) -> None:
    now, steps = 0.0, iter([judged(n, False, n * 10**8, program_id="mine") for n in range(1, 20)])
    monkeypatch.setattr(send, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(send, "decode_step", lambda step: step)
    node, heard = Mock(), {}
    node.create_subscription = lambda _, name, to, *_rest, **_how: heard.update({name: to})
    node.get_publishers_info_by_topic = lambda _: []

    def spin(condition, timeout_s: float) -> bool:
        nonlocal now
        while not condition():
            now += 1.0
            if (step := next(steps, None)) is not None:
                heard["object_features"](step)
        return True

    sender = send.ProgramSender(node, lambda condition, timeout_s: True)
    sender.send("NEAR(HAND, RED)", 1.0, time_s=100.0, program_id="mine")
    sender._spin = spin  # noqa: SLF001
    with pytest.raises(NoAnswerError, match="no step under the program arrived within 3 s"):
        sender.wait(PATIENCE_S)
    assert now > 19 + PATIENCE_S
