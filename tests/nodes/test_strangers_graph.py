"""Strangers that speak for a real arena, agent or learner: nothing false is learned, nothing stops.

All tests share one graph that learns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL_LEARNER, Probe, Witness, graph
from helpers.learners import ARENA, WORLD, snapshot, trajectory
from learner_node.node import LearnerNode
from pa_ros.core.experience import PublishedPolicy
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import (
    decode_learner_info,
    decode_trajectory,
    encode_learner_info,
    encode_trajectory,
    encode_weights,
)
from pa_ros.wire.step import Command, encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
LEARNING = {"agent_node__learning": True, "agent_node__agent_id": "real", **SMALL_LEARNER}


@pytest.fixture(scope="module")
def running(module_domain: str) -> Iterator[Probe]:
    with graph(SimNode, AgentNode, LearnerNode, **LEARNING) as probe:
        yield probe


@pytest.fixture
def probe(running: Probe) -> Probe:
    """The graph when all is well."""
    assert running.until(lambda: running.message("learner_node") == "learning")
    assert running.until(lambda: running.message("agent_node") == "acting")
    return running


def learns_on(probe: Probe) -> bool:
    then = float(probe.value("learner_node", "frames"))
    return probe.until(lambda: float(probe.value("learner_node", "frames")) > then + 300)


def test_commands_in_a_real_agents_name_spoil_no_transition(probe: Probe) -> None:
    arena, node, _ = probe.nodes
    witness, rng = Witness(arena.session), np.random.default_rng(0)
    begun, interrupted = arena.session.frame.observation.episode, node.agent.interrupted
    stranger = topics.JOINT_COMMANDS.publisher(probe)

    def forge(features: Any) -> None:
        last = node.agent.last_command
        number = 1 if last is None else last.command.number + 1
        action = rng.uniform(-1, 1, 6).astype(np.float32)
        where = features.episode, features.step, header_stamp(features)
        forged = Command(*where, "real", 0, action, node.agent.key.incarnation, number)
        if rng.random() < 0.3:
            stranger.publish(encode_command(forged))

    forging = topics.OBJECT_FEATURES.subscribe(probe, forge)
    probe.heard["trajectories"].clear()
    assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 40)
    probe.destroy_subscription(forging)
    learned = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
    assert not witness.false(one for one in learned if one.episode > begun)
    assert node.agent.interrupted > interrupted  # some forged commands were executed


def strange_arena(probe: Probe) -> Any:
    return encode_arena_info(replace(ARENA, arena_id="strange", thresholds=(9.0,)))


def forged_arena(probe: Probe) -> Any:
    arena = decode_arena_info(probe.last(topics.ARENA_INFO))
    return encode_arena_info(replace(arena, thresholds=(9.0,)))


def forged_learner(probe: Probe) -> Any:
    learner = decode_learner_info(probe.last(topics.LEARNER_INFO))
    return encode_learner_info(replace(learner, thresholds=(9.0,), stamp_ns=2**62))


def nobodys_weights(probe: Probe) -> Any:
    return encode_weights(PublishedPolicy(snapshot(9), "nobody's", "nobody"))


@pytest.mark.parametrize(
    ("topic", "make", "said"),
    [
        (topics.ARENA_INFO, forged_arena, "is described differently than before"),
        (topics.ARENA_INFO, strange_arena, "describes itself, but sends nothing else"),
        (topics.LEARNER_INFO, forged_learner, "is described differently than before"),
        (topics.POLICY_WEIGHTS, nobodys_weights, "never described itself"),
    ],
)
def test_a_strangers_latched_message_is_an_error_and_stops_nothing(probe, topic, make, said):
    speaker = probe.create_publisher(topic.type, topic.name, topic.writer)
    assert probe.until(lambda: speaker.get_subscription_count() >= 2)
    heard = len(probe.heard[topic.name])
    kept = list(probe.heard[topic.name])
    speaker.publish(make(probe))
    assert probe.until(lambda: said in probe.message("agent_node"))
    assert probe.health["/agent_node"].level == ERROR
    assert learns_on(probe)
    assert heard  # the real one was published before
    probe.destroy_publisher(speaker)
    probe.heard[topic.name][:] = kept  # other tests look at the real ones


@pytest.mark.parametrize("held_from", [0, 10**6])
def test_a_trajectory_far_ahead_under_a_real_agents_name_stops_nothing(probe, held_from) -> None:
    _, node, _ = probe.nodes
    key = node.agent.key
    forged = replace(trajectory(10**6, "real"), incarnation=key.incarnation, held_from=held_from)
    probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(forged))
    if held_from:
        assert probe.until(lambda: probe.value("learner_node", "lost_trajectories") != "0")
        assert probe.until(lambda: "under this agent_id" in probe.message("agent_node"))
    else:
        refused = "refused.learning.ahead"
        assert probe.until(lambda: probe.value("learner_node", refused) == "1")
    assert learns_on(probe)
    assert len(node.agent.unaccounted) < 5
