"""Weights on the graph: the right ones act, wrong ones are refused, none is an alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers import learners
from helpers.graph import graph
from pa_ros.arena import design_named
from pa_ros.core.experience import PolicySnapshot
from pa_ros.core.published import PublishedPolicy
from pa_ros.language import Vocabulary
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.learning import decode_trajectory, encode_learner_info, encode_weights
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
WORDS = design_named("2-L").vocabulary
WORLD = World(PAPER, WORDS, joints=6)


LEARNER = replace(
    learners.LEARNER,
    architecture=NetworkConfig(world=WORLD, hidden=16).architecture,
    trajectory_steps=100,
)


def policy(version: int = 0, vocabulary: Vocabulary = WORDS, **options) -> PublishedPolicy:
    network = NetworkConfig(world=World(PAPER, vocabulary, joints=6), **{"hidden": 16, **options})
    tensors = initial_actor(network, np.random.default_rng(0))
    snapshot = PolicySnapshot(version, network.architecture, network.world.digest, tensors)
    return PublishedPolicy(snapshot, LEARNER.run_id, LEARNER.learner_id)


def _truncated():
    message = encode_weights(policy(9))
    message.payload = message.payload[:-4]
    return message


def _wrong_checksum():
    message = encode_weights(policy(9))
    message.payload[0] ^= 1
    return message


def _missing_tensor():
    good = policy(9)
    tensors = dict(list(good.snapshot.tensors.items())[:-1])
    return encode_weights(replace(good, snapshot=replace(good.snapshot, tensors=tensors)))


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        (encode_weights(policy(9, hidden=8)), "learning.policy"),
        (
            encode_weights(policy(9, Vocabulary.of(shape=("CUBE",), color=("RED",)))),
            "wire.world",
        ),
        (_truncated(), "wire.truncated"),
        (_wrong_checksum(), "wire.checksum"),
        (_missing_tensor(), "learning.policy"),
    ],
)
def test_bad_weights_are_refused_and_the_good_ones_go_on_acting(bad, code):
    with graph(SimNode, AgentNode) as probe:
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        speaker.publish(encode_weights(policy(3)))
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        speaker.publish(bad)
        agent, refusals = probe.nodes[1].agent, probe.nodes[1].refusals
        assert probe.until(lambda: refusals.total == 1)
        assert set(refusals.counts) == {code}
        commands = probe.count(topics.JOINT_COMMANDS)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > commands + 50)
        assert agent.version == 3 and probe.last(topics.JOINT_COMMANDS).policy_version == 3
        speaker.publish(encode_weights(policy(4)))
        assert probe.until(lambda: agent.version == 4)
        assert probe.until(lambda: probe.value("agent_node", "policy_version") == "4")


def test_weights_of_another_vocabulary_than_the_arenas_are_refused_first_of_all():
    with graph(SimNode, AgentNode) as probe:
        assert probe.until(lambda: probe.count(topics.ARENA_INFO) > 0)
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        probe.until(lambda: False, 0.3)
        speaker.publish(encode_weights(policy(9, Vocabulary.of(shape=("CUBE",), color=("RED",)))))
        assert probe.until(lambda: probe.nodes[1].refusals.counts["wire.world"] == 1)
        assert not probe.nodes[1].agent.has_weights


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
        speaker.publish(encode_weights(policy(0)))
        probe.speaker(topics.LEARNER_INFO).publish(encode_learner_info(LEARNER))
        assert probe.until(lambda: "stuck at 0" in probe.message("agent_node"))
        trajectories = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
        assert {s.sequence for s in trajectories} == {0, 1}  # lag 1: one more than the weights
        assert len(trajectories) > 2  # sent again: perhaps nobody heard them
        assert probe.value("agent_node", "policy_version") == "0"
        assert all(s.policy_version == 0 and len(s) == 100 for s in trajectories)
        assert "trajectories before 1" in probe.message("agent_node")
        agent = probe.nodes[1].agent
        speaker.publish(encode_weights(replace(policy(1), accounted={agent.key: 1})))
        assert probe.until(lambda: agent.version == 1)
        assert probe.until(lambda: probe.message("agent_node") == "acting")


MISFITS: list[tuple[dict[str, object], str]] = [
    ({"thresholds": (0.1,)}, "learner_info.thresholds: expected (0.2,), as this"),
    ({"control_period": 0.5}, "learner_info.control_period: expected 0.1, as this"),
    ({"world_digest": "f" * 16}, "learner_info.world_digest: expected "),
    ({"architecture": '{"kind":"deep"}'}, "learner_info.architecture: "),
    ({"exploration": '{"process":"white"}'}, "learner_info.exploration: "),
]


@pytest.mark.parametrize(("change", "reason"), MISFITS)
def test_an_agent_that_cannot_do_as_the_learner_asks_says_so_and_does_not_act(change, reason):
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        speaker = probe.speaker(topics.LEARNER_INFO)
        speaker.publish(encode_learner_info(replace(LEARNER, **change)))
        probe.speaker(topics.POLICY_WEIGHTS).publish(encode_weights(policy(0)))
        refused = "refused.learner.request"
        assert probe.until(lambda: probe.value("agent_node", refused) == "1")
        assert probe.message("agent_node").startswith(f"does not act for the learner: {reason}")
        assert probe.health["/agent_node"].level == ERROR
        assert probe.count(topics.JOINT_COMMANDS) == 0
        another = replace(LEARNER, learner_id="another", stamp_ns=2)  # and one that it can serve
        speaker.publish(encode_learner_info(another))
        weights = replace(policy(0), learner_id="another")
        probe.speaker(topics.POLICY_WEIGHTS).publish(encode_weights(weights))
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        does_not = "does not act for the learner"
        assert probe.until(lambda: not probe.message("agent_node").startswith(does_not))


def test_a_learner_of_another_edition_of_the_messages_is_refused():
    message = encode_learner_info(LEARNER)
    message.wire_version = "1"
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        probe.speaker(topics.LEARNER_INFO).publish(message)
        assert probe.until(lambda: probe.value("agent_node", "refused.wire.version") == "1")
        assert probe.count(topics.JOINT_COMMANDS) == 0
