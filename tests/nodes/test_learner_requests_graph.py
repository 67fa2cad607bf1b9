"""An agent that learns does what its learner asks, or says why it can't."""

from dataclasses import replace

import pytest

from agent_node.node import AgentNode
from helpers import learners
from helpers.graph import graph
from helpers.learners import LEARNER, WORLD, published
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.learning import decode_trajectory, encode_learner_info, encode_weights
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def test_a_learning_agent_waits_for_weights_beyond_the_policy_lag() -> None:
    """The update-to-data ratio from the agent's side: without new weights no new experience."""
    times = {"agent_node__stuck_after_s": 1.0, "agent_node__resend_period_s": 0.5}
    with graph(SimNode, AgentNode, agent_node__learning=True, **times) as probe:
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        speaker.publish(encode_weights(published(0)))
        probe.speaker(topics.LEARNER_INFO).publish(encode_learner_info(LEARNER))
        assert probe.until(lambda: "stuck at 0" in probe.message("agent_node"))
        # They are sent again: perhaps nobody received them.
        assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 2)
        trajectories = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
        assert {s.sequence for s in trajectories} == {0, 1}  # lag 1: one more than the weights
        assert all(s.policy_version == 0 and len(s) == 10 for s in trajectories)
        assert "trajectories before 1" in probe.message("agent_node")
        _, node = probe.nodes
        speaker.publish(encode_weights(replace(published(1), accounted={node.agent.key: 1})))
        assert probe.until(lambda: probe.value("agent_node", "policy_version") == "1")
        assert probe.until(lambda: probe.message("agent_node") == "acting")


def test_an_agent_that_cannot_comply_with_the_learner_does_not_act() -> None:
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        speaker = probe.speaker(topics.LEARNER_INFO)
        other_edition = encode_learner_info(LEARNER)
        other_edition.wire_version = "1"
        speaker.publish(other_edition)
        assert probe.until(lambda: probe.value("agent_node", "refused.wire.version") == "1")
        speaker.publish(encode_learner_info(replace(LEARNER, thresholds=(0.1,))))
        weights = probe.speaker(topics.POLICY_WEIGHTS)
        weights.publish(encode_weights(published(0)))
        reason = "does not act for the learner: learner_info.thresholds: expected (0.2,)"
        assert probe.until(lambda: probe.message("agent_node").startswith(reason))
        assert probe.health["/agent_node"].level == ERROR
        assert probe.value("agent_node", "refused.learner.request") == "1"
        assert probe.count(topics.JOINT_COMMANDS) == 0
        another = replace(LEARNER, learner_id="another", stamp_ns=2)  # one that it can serve
        speaker.publish(encode_learner_info(another))
        weights.publish(encode_weights(replace(learners.published(0), learner_id="another")))
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        assert probe.until(lambda: not probe.message("agent_node").startswith("does not act"))
