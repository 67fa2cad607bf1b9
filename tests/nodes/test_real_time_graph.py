"""An arena in real time: watchdog, speed (invariant 7)."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from helpers.graph import Probe, graph
from helpers.messages import answer
from pa_ros.ros import topics
from pa_ros.wire.services import encode_speed
from pa_ros.wire.step import encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


@pytest.fixture(scope="module")
def probe(module_domain: str) -> Iterator[Probe]:
    """One arena for all tests of this module. A busy machine keeps up with real time."""
    with graph(SimNode, sim_node__mode="real_time") as probe:
        yield probe


@pytest.fixture(scope="module")
def commands(probe: Probe) -> Any:
    return probe.speaker(topics.JOINT_COMMANDS)


def speed(probe: Probe) -> float:
    return float(np.abs(probe.nodes[0].session.current.observation.joint_velocity).max())


def test_the_arm_moves_while_commands_arrive_and_holds_when_they_stop(probe, commands):
    sim = probe.nodes[0]
    answered = {0}

    def moves() -> bool:
        seen = sim.session.current.observation
        if seen.stamp_ns not in answered:  # once each: on a busy machine more would queue up
            answered.add(seen.stamp_ns)
            commands.publish(encode_command(answer(seen)))
        return speed(probe) > 0.3

    assert probe.until(moves)
    held = sim.watchdog.holds
    assert probe.until(lambda: sim.watchdog.holds > held + 5)
    assert speed(probe) < 0.05
    assert probe.until(lambda: int(probe.value("sim_node", "holds") or 0) > held)


def test_the_real_time_factor_is_kept_reported_and_can_be_changed(probe):
    def factor() -> float:
        return float(probe.value("sim_node", "real_time_factor") or 0.0)

    assert probe.until(lambda: 0.8 < factor() < 1.2)
    changed = probe.call(topics.SPEED, encode_speed(2.0))
    assert changed.success and changed.real_time_factor == 2.0
    assert probe.until(lambda: 1.6 < factor() < 2.4)
    assert not probe.call(topics.SPEED, encode_speed(-1.0)).success


def test_a_new_speed_counts_at_once_even_after_a_very_slow_one(probe):
    sim = probe.nodes[0]
    assert probe.call(topics.SPEED, encode_speed(0.01)).success  # 10 s a step
    assert probe.call(topics.SPEED, encode_speed(5.0)).success
    changed, steps = time.monotonic(), sim.session.steps
    assert probe.until(lambda: sim.session.steps >= steps + 5)
    assert time.monotonic() - changed < 5.0
