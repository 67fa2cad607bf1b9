"""Weights on the graph: the right ones act, wrong ones are refused, none is an alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from graph import graph

from agent_node.node import AgentNode
from pa_ros.arena import design_named
from pa_ros.core.experience import PolicySnapshot
from pa_ros.language import Vocabulary
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor
from pa_ros.ros import topics
from pa_ros.wire import codec
from pa_ros.wire.records import PublishedPolicy
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
WORDS = design_named("2-L").vocabulary


def policy(version: int = 0, vocabulary: Vocabulary = WORDS, **options) -> PublishedPolicy:
    network = NetworkConfig(vocabulary=vocabulary, **{"hidden": 16, **options})
    tensors = initial_actor(network, np.random.default_rng(0))
    snapshot = PolicySnapshot(version, network.architecture, vocabulary.digest, tensors)
    return PublishedPolicy(snapshot, "run", {})


def _truncated():
    message = codec.encode_weights(policy(9))
    message.payload = message.payload[:-4]
    return message


def _wrong_checksum():
    message = codec.encode_weights(policy(9))
    message.payload[0] ^= 1
    return message


def _missing_tensor():
    good = policy(9)
    tensors = dict(list(good.snapshot.tensors.items())[:-1])
    return codec.encode_weights(replace(good, snapshot=replace(good.snapshot, tensors=tensors)))


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        (codec.encode_weights(policy(9, hidden=8)), "wire.architecture"),
        (codec.encode_weights(policy(9, Vocabulary(("CUBE",), ("RED",)))), "wire.architecture"),
        (_truncated(), "wire.truncated"),
        (_wrong_checksum(), "wire.checksum"),
        (_missing_tensor(), "networks.tensors"),
    ],
)
def test_bad_weights_are_refused_and_the_good_ones_go_on_acting(bad, code):
    with graph(SimNode, AgentNode) as probe:
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        speaker.publish(codec.encode_weights(policy(3)))
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        speaker.publish(bad)
        driver, refusals = probe.nodes[1].driver, probe.nodes[1].refusals
        assert probe.until(lambda: refusals.total == 1)
        assert set(refusals.counts) <= {code, "learning.policy"}
        commands = probe.count(topics.JOINT_COMMANDS)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > commands + 50)
        assert driver.version == probe.last(topics.JOINT_COMMANDS).policy_version == 3
        speaker.publish(codec.encode_weights(policy(4)))
        assert probe.until(lambda: driver.version == 4)
        assert probe.until(lambda: probe.value("agent_node", "policy_version") == "4")


def test_weights_of_another_vocabulary_than_the_arenas_are_refused_first_of_all():
    with graph(SimNode, AgentNode) as probe:
        assert probe.until(lambda: probe.count(topics.ARENA_INFO) > 0)
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        probe.until(lambda: False, 0.3)
        speaker.publish(codec.encode_weights(policy(9, Vocabulary(("CUBE",), ("RED",)))))
        assert probe.until(lambda: probe.nodes[1].refusals.counts["wire.vocabulary"] == 1)
        assert not probe.nodes[1].driver.ready


def test_a_learning_agent_runs_ahead_by_the_lag_alone_and_then_alarms():
    """The update-to-data ratio from the agent's side: without new weights no new experience."""
    with graph(
        SimNode,
        AgentNode,
        agent_node__learning=True,
        agent_node__stuck_after_s=1.0,
        agent_node__resend_period_s=0.5,
    ) as probe:
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        speaker.publish(codec.encode_weights(policy(0)))
        assert probe.until(lambda: "stuck at 0" in probe.message("agent_node"))
        trajectories = [codec.decode_trajectory(m) for m in probe.heard["trajectories"]]
        assert {s.sequence for s in trajectories} == {0, 1}  # lag 1: one more than the weights
        assert len(trajectories) > 2  # sent again: perhaps nobody heard them
        assert probe.value("agent_node", "policy_version") == "0"
        assert all(s.policy_version == 0 and len(s) == 100 for s in trajectories)
        agent = probe.nodes[1].agent_id
        speaker.publish(codec.encode_weights(replace(policy(1), consumed={agent: 0})))
        assert probe.until(lambda: probe.nodes[1].driver.version == 1)
