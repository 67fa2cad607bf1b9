"""Real time: watchdog, real-time factor, silence for silence (invariant 7)."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import graph
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.services import encode_speed
from pa_ros.wire.step import Command, encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
REAL_TIME = {"sim_node__mode": "real_time", "sim_node__real_time_factor": 5.0}


def reached(sim: SimNode, steps: int) -> bool:
    return sim.session.steps >= steps


def test_the_watchdog_holds_the_arm_when_commands_stop():
    with graph(SimNode, **REAL_TIME) as probe:
        sim = probe.nodes[0]
        speaker = probe.speaker(topics.JOINT_COMMANDS)
        action = np.full(6, 0.5, np.float32)

        def answer() -> None:
            seen = probe.last(topics.OBJECT_FEATURES)
            stamp = header_stamp(seen)
            command = Command(seen.episode, seen.step, stamp, "me", 0, action)
            speaker.publish(encode_command(command))

        assert probe.until(lambda: probe.count(topics.OBJECT_FEATURES) > 0)
        for _ in range(4):
            answer()
            later = sim.session.steps + 2
            assert probe.until(partial(reached, sim, later))
        assert max(abs(m.velocity[0]) for m in probe.heard["joint_states"]) > 0.3
        held = sim.watchdog.holds
        assert probe.until(lambda: sim.watchdog.holds > held + 5)
        assert np.abs(probe.last(topics.JOINT_STATES).velocity).max() < 0.05
        assert probe.until(lambda: int(probe.value("sim_node", "holds") or 0) > held)


def test_old_commands_and_other_episodes_are_refused():
    with graph(SimNode, **REAL_TIME) as probe:
        sim = probe.nodes[0]
        speaker = probe.speaker(topics.JOINT_COMMANDS)
        assert probe.reaches(8)
        now = sim.session.frame.observation.stamp_ns
        for episode, stamp in ((0, now - 10**9), (1, now), (0, now + 10**10)):
            command = Command(episode, 0, stamp, "me", 0, np.ones(6, np.float32))
            speaker.publish(encode_command(command))
        assert probe.until(lambda: probe.value("sim_node", "refused.command.stale") == "3")
        assert np.abs(probe.last(topics.JOINT_STATES).velocity).max() < 0.05


def test_the_real_time_factor_is_kept_reported_and_can_be_changed():
    with graph(SimNode, AgentNode, agent_node__weights="random", **REAL_TIME) as probe:

        def factor() -> float:
            return float(probe.value("sim_node", "real_time_factor") or 0.0)

        assert probe.until(lambda: 4.0 < factor() < 6.0)
        changed = probe.call(topics.SPEED, encode_speed(2.0))
        assert changed.success and changed.real_time_factor == 2.0
        assert probe.until(lambda: 1.5 < factor() < 2.5)
        assert not probe.call(topics.SPEED, encode_speed(-1.0)).success


def test_a_slow_period_under_way_does_not_outlive_another_speed():
    with graph(SimNode, **REAL_TIME) as probe:
        sim = probe.nodes[0]
        assert probe.reaches(3)
        assert probe.call(topics.SPEED, encode_speed(0.01)).success  # 10 s a step
        assert probe.call(topics.SPEED, encode_speed(5.0)).success
        changed, steps = time.monotonic(), sim.session.steps
        assert probe.until(partial(reached, sim, steps + 5)) and time.monotonic() - changed < 5.0


def test_the_agent_stops_commanding_when_observations_stop():
    with graph(SimNode, AgentNode, agent_node__weights="random", **REAL_TIME) as probe:
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 5)
        assert probe.pause().success
        assert probe.until(lambda: "waits for observations" in probe.message("agent_node"))
        sent = probe.count(topics.JOINT_COMMANDS)
        probe.until(lambda: False, 0.5)
        assert probe.count(topics.JOINT_COMMANDS) == sent
        assert probe.pause(False).success
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > sent + 5)
