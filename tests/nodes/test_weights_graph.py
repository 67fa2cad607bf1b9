"""Weights on the graph: the right ones act, wrong ones are refused. All tests share one graph."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from agent_node.node import AgentNode
from helpers import learners
from helpers.graph import Probe, graph
from pa_ros.core.experience import PolicySnapshot
from pa_ros.networks.config import NetworkConfig
from pa_ros.ros import topics
from pa_ros.wire.learning import encode_learner_info, encode_weights
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
GOOD = learners.snapshot(9)


@pytest.fixture(scope="module")
def probe(module_domain: str) -> Iterator[Probe]:
    """An agent that received hostile latched weights before any others, and then good ones."""
    with graph(SimNode) as probe:
        stranger = topics.POLICY_WEIGHTS.publisher(probe)
        for make in HOSTILE:
            stranger.publish(make())
        agent = AgentNode()
        probe.nodes.append(agent)
        assert probe.until(lambda: agent.refusals.total == len(HOSTILE))
        probe.speaker(topics.POLICY_WEIGHTS).publish(encode_weights(learners.published(3)))
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        yield probe


def shaped(shape: list[int]) -> Any:
    message = encode_weights(learners.published(9))
    message.tensors[0].shape = shape
    return message


def of(snapshot: PolicySnapshot) -> Any:
    return encode_weights(replace(learners.published(9), snapshot=snapshot))


HOSTILE = (
    lambda: shaped([1] * 65),
    lambda: shaped([2**32 - 1] * 8),
    lambda: shaped([0, 2**32 - 1, 2**32 - 1]),
    lambda: of(replace(GOOD, architecture="[" * 200_000)),
)


def wrong_checksum() -> Any:
    message = encode_weights(learners.published(9))
    message.payload[0] ^= 1
    return message


def of_another_size() -> Any:
    return of(learners.snapshot(9, NetworkConfig(world=learners.WORLD, hidden=4, attention=2)))


def test_invalid_latched_messages_are_refused(probe: Probe) -> None:
    _, agent = probe.nodes
    expected = {"wire.size", "wire.truncated", "learning.policy", "wire.range"}
    assert set(agent.refusals.counts) <= expected


@pytest.mark.parametrize(
    ("bad", "code"), [(of_another_size, "learning.policy"), (wrong_checksum, "wire.checksum")]
)
def test_bad_weights_are_refused_and_the_good_ones_keep_acting(probe: Probe, bad, code) -> None:
    _, agent = probe.nodes
    counts = agent.refusals.counts
    probe.speaker(topics.POLICY_WEIGHTS).publish(bad())
    assert probe.until(lambda: agent.refusals.counts[code] == counts[code] + 1)
    assert agent.refusals.total == counts.total() + 1
    commands = probe.count(topics.JOINT_COMMANDS)
    assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > commands + 50)
    assert probe.last(topics.JOINT_COMMANDS).policy_version == 3


def test_a_described_learner_replaces_one_that_sends_only_weights(probe: Probe) -> None:
    """Of another size, so that the agent must make another network."""
    network = NetworkConfig(world=learners.WORLD, hidden=4, attention=2)
    real = replace(learners.LEARNER, learner_id="real", architecture=network.architecture)
    weights = replace(learners.published(1, learner=real), snapshot=learners.snapshot(1, network))
    probe.speaker(topics.LEARNER_INFO).publish(encode_learner_info(real))
    speaker = probe.speaker(topics.POLICY_WEIGHTS)
    speaker.publish(encode_weights(weights))
    assert probe.until(lambda: probe.last(topics.JOINT_COMMANDS).policy_version == 1)
    undescribed = encode_weights(learners.published(7))
    said = lambda: "learner never described itself" in probe.message("agent_node")  # noqa: E731
    assert probe.sees(said, lambda: speaker.publish(undescribed))
    assert probe.last(topics.JOINT_COMMANDS).policy_version == 1
    newer = replace(weights, snapshot=learners.snapshot(2, network))
    speaker.publish(encode_weights(newer))
    assert probe.until(lambda: probe.value("agent_node", "policy_version") == "2")
