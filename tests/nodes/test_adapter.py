"""The ramp of an arm whose arena is followed by another one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from agent_node.adapter import Adapter
from agent_node.config import AgentConfig


def _arena(joints: str) -> Any:
    limits = (1.5,) * len(joints)
    return SimpleNamespace(speed_limits=limits, control_period=0.1, joint_names=tuple(joints))


@pytest.mark.parametrize("others", ["pqrstuv", "pqrstu"])
@pytest.mark.parametrize("controller", ["velocity", "joint_trajectory"])
def test_a_ramp_ends_with_the_arm_that_it_is_of(monkeypatch, controller, others) -> None:
    now = [0.0]
    monkeypatch.setattr("agent_node.adapter.time.monotonic", lambda: now[0])
    sent: list[Any] = []
    node, here = Mock(), [_arena("abcdef")]
    node.create_publisher.return_value = SimpleNamespace(publish=sent.append)
    config = AgentConfig(controller=controller, max_acceleration=0.2)
    adapter = Adapter(node, config, lambda: here[0])

    def send() -> None:
        now[0] += 0.1
        joints = len(here[0].joint_names)
        seen: Any = SimpleNamespace(joint_position=np.zeros(joints))
        adapter.send(np.ones(joints, np.float32), seen)

    for _ in range(5):
        send()
    now[0] += 0.1
    adapter.rest()
    assert len(sent) == 6  # down the ramp
    first, here[0] = here[0], _arena(others)
    now[0] += 0.1
    adapter.rest()
    adapter.stop()
    assert len(sent) == 6
    here[0] = first
    adapter.rest()
    assert len(sent) == 6  # nor later
    here[0] = _arena(others)
    send()
    assert len(sent) == 7
    now[0] += 0.1
    adapter.rest()
    named = sent[-1].data if controller == "velocity" else sent[-1].joint_names
    assert len(sent) == 8 and len(named) == len(others)
