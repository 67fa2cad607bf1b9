"""Setpoints for controllers: a ramp belongs to the arm of one arena."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from agent_node.config import AgentConfig
from agent_node.outputs import ControllerOutput


@pytest.mark.parametrize("controller", ["velocity", "joint_trajectory"])
def test_velocity_ramps_down_when_commands_stop_and_another_arm_starts_at_rest(
    monkeypatch, controller, clock
) -> None:
    monkeypatch.setattr("agent_node.outputs.time.monotonic", clock)
    sent: list[Any] = []
    node = Mock(config=AgentConfig(controller=controller, max_acceleration=0.2))
    node.create_publisher.return_value = SimpleNamespace(publish=sent.append)
    output = ControllerOutput(node)

    def bind(joints: str) -> None:
        arena: Any = SimpleNamespace(control_period=0.1, joint_names=tuple(joints))
        arena.speed_limits = (1.5,) * len(joints)
        output.bind(arena)

    def send(joints: int) -> None:
        clock.now += 0.1
        output.send(np.ones(joints, np.float32), np.zeros(joints))

    bind("abcdef")
    for _ in range(5):
        send(6)
    clock.now += 0.1
    output.rest()
    assert len(sent) == 6  # the first step down
    if controller == "joint_trajectory":  # 0.1 s at 0.1 rad/s later, 0.08 rad/s for 0.1 s
        assert sent[-1].points[0].positions == pytest.approx([0.018] * 6)
    bind("pqrstuv")
    output.rest()
    output.stop()
    assert len(sent) == 6  # the new arm does not move
    send(7)
    clock.now += 0.1
    output.stop()
    named = sent[-1].data if controller == "velocity" else sent[-1].joint_names
    assert len(sent) == 8 and len(named) == 7
