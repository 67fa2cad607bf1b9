"""Others that speak for an agent, an arena or a learner: nothing false is learned, all is said."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import learners
import numpy as np
import pytest
from graph import Probe, graph
from reenacted import Witness

from agent_node.node import AgentNode
from pa_ros.acting.agent import Agent
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.experience import AgentKey
from pa_ros.ros import topics
from pa_ros.ros.health import OK, WARN
from pa_ros.wire import codec
from pa_ros.wire.records import Command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
LEARNER = replace(learners.LEARNER, policy_lag=10**6)  # never waited for
LEARNING = {"agent_node__learning": True, "agent_node__agent_id": "real"}
ENOUGH = 40  # trajectories


class Twin(AgentNode):
    """Another agent under the same name, that explores otherwise."""

    def _make_agent(self) -> Agent:
        return LearningAgent(AgentKey(self.agent_id, 7), seed=7)


def announce(probe: Probe) -> None:
    weights = learners.published(0, learner=LEARNER)
    probe.speaker(topics.POLICY_WEIGHTS).publish(codec.encode_weights(weights))
    probe.speaker(topics.LEARNER_INFO).publish(codec.encode_learner_info(LEARNER))


def false_transitions(probe: Probe, witness: Witness) -> list[str]:
    """Of at least ENOUGH trajectories, those that never happened."""
    assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > ENOUGH)
    heard = [codec.decode_trajectory(m, learners.WORDS) for m in probe.heard["trajectories"]]
    return witness.false(heard)


def test_two_agents_under_one_id_never_join_what_the_other_did() -> None:
    with graph(SimNode, AgentNode, Twin, **LEARNING) as probe:
        witness = Witness(probe.nodes[0].session)
        announce(probe)
        assert not false_transitions(probe, witness)
        assert probe.value("sim_node", "refused.command.stale") != ""


def test_a_stranger_with_a_real_id_and_the_next_number_spoils_no_transition() -> None:
    with graph(SimNode, AgentNode, **LEARNING) as probe:
        witness = Witness(probe.nodes[0].session)
        agent, rng = probe.nodes[1].agent, np.random.default_rng(0)
        stranger = probe.create_publisher(
            topics.JOINT_COMMANDS.type, "joint_commands", topics.JOINT_COMMANDS.writer
        )

        def forge(features: Any) -> None:
            number = 1 if agent.sent is None else agent.sent.command.number + 1
            action = rng.uniform(-1, 1, 6).astype(np.float32)
            where = features.episode, features.step, codec.header_stamp(features)
            forged = Command(*where, "real", 0, action, agent.key.incarnation, number)
            if rng.random() < 0.3:
                stranger.publish(codec.encode_command(forged))

        kind = topics.OBJECT_FEATURES
        probe.create_subscription(kind.type, kind.name, forge, kind.reader)
        announce(probe)
        assert not false_transitions(probe, witness)
        assert probe.nodes[1].agent.interrupted > 0  # it did get between


@contextmanager
def process(node: str, *parameters: str) -> Iterator[None]:
    """A node of ours as a process of its own; killed as it leaves."""
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    with subprocess.Popen([sys.executable, "-m", f"{node}.main", "--ros-args", *arguments]) as one:
        try:
            yield
        finally:
            one.kill()


def test_a_second_agent_is_an_alarm_until_it_is_gone() -> None:
    with graph(SimNode, AgentNode, agent_node__weights="random") as probe:
        with process("agent_node", "weights:=random"):
            assert probe.until(lambda: "not alone on /joint_c" in probe.message("agent_node"))
            assert "stop all but one" in probe.message("agent_node")
            assert probe.health["/agent_node"].level == WARN
            assert probe.until(lambda: "several command the arm" in probe.message("sim_node"))
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.until(lambda: probe.message("sim_node") == "running")
        assert probe.health["/agent_node"].level == probe.health["/sim_node"].level == OK


def test_a_second_arena_is_an_alarm_and_its_steps_are_not_joined_with_the_firsts() -> None:
    with graph(SimNode, AgentNode, **LEARNING) as probe:
        witness = Witness(probe.nodes[0].session)
        announce(probe)
        assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 2)
        with process("sim_node", "seed:=5"):
            assert probe.until(lambda: "not alone on /arena_info" in probe.message("sim_node"))
            assert probe.until(lambda: "steps of other arenas" in probe.message("agent_node"))
            assert int(probe.value("agent_node", "refused.observation.arena")) > 0
        assert not false_transitions(probe, witness)
        assert probe.until(lambda: probe.message("sim_node") == "running")
        assert probe.until(lambda: probe.message("agent_node") == "acting")
