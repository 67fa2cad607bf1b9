"""Forged messages in the name of an arena, agent or learner: nothing false is learned.

All tests share one graph that learns.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL_LEARNER, Probe, Witness, graph
from helpers.learners import ARENA, WORLD, snapshot
from helpers.messages import observation
from learner_node.node import LearnerNode
from pa_ros.core.experience import PublishedPolicy, Step, Verdict
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import (
    decode_learner_info,
    decode_trajectory,
    encode_learner_info,
    encode_weights,
)
from pa_ros.wire.step import Command, encode_command, encode_verdict
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


def test_commands_forged_in_the_agents_name_falsify_no_transition(probe: Probe) -> None:
    arena, node, _ = probe.nodes
    witness, rng = Witness(arena.session), np.random.default_rng(0)
    begun, sent = arena.session.current.observation.episode, set[bytes]()
    stranger = topics.JOINT_COMMANDS.publisher(probe)

    def forge(features: Any) -> None:
        last = node.agent.last_command
        number = 1 if last is None else last.command.number + 1
        action = rng.uniform(-1, 1, 6).astype(np.float32)
        # For the next step, so that it arrives before the agent's own.
        where = features.episode, features.step + 1, header_stamp(features) + 10**8
        forged = Command(*where, "real", 0, action, node.agent.key.incarnation, number)
        if rng.random() < 0.1:
            sent.add(action.tobytes())
            stranger.publish(encode_command(forged))

    forging = topics.OBJECT_FEATURES.subscribe(probe, forge)
    probe.heard["trajectories"].clear()
    assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 15)
    probe.destroy_subscription(forging)
    learned = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
    assert not witness.false(one for one in learned if one.episode > begun)
    acted = {action.tobytes() for one in learned for action in one.actions}
    assert acted & sent, "forged commands that were executed are learned from as what they were"


def test_a_strangers_verdicts_are_learned_by_nobody(probe: Probe) -> None:
    stranger = topics.VERDICT.publisher(probe)

    def judge_the_next(features: Any) -> None:
        next_ns = header_stamp(features) + 10**8
        seen = replace(observation(), stamp_ns=next_ns, step=features.step + 1)
        stranger.publish(encode_verdict(Step(seen, Verdict(777.0, True, 0.0, False))))

    judging = topics.OBJECT_FEATURES.subscribe(probe, judge_the_next)
    probe.heard["trajectories"].clear()
    assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 5)
    probe.destroy_subscription(judging)
    learned = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
    assert {reward for one in learned for reward in one.rewards} <= {-1.0, 1.0}


def strange_arena(probe: Probe) -> Any:
    return encode_arena_info(replace(ARENA, arena_id="strange", thresholds=(9.0,)))


def forged_arena(probe: Probe) -> Any:
    arena = decode_arena_info(probe.heard["arena_info"][0])
    return encode_arena_info(replace(arena, thresholds=(9.0,)))


def forged_learner(probe: Probe) -> Any:
    learner = decode_learner_info(probe.heard["learner_info"][0])
    return encode_learner_info(replace(learner, thresholds=(9.0,), stamp_ns=2**62))


def nobodys_weights(probe: Probe) -> Any:
    return encode_weights(PublishedPolicy(snapshot(9), "nobody's", "nobody"))


@pytest.mark.parametrize(
    "strangers",
    [
        [
            (topics.ARENA_INFO, forged_arena, "is described differently than before"),
            (topics.ARENA_INFO, strange_arena, "strange describes itself, but sends nothing else"),
        ],
        [
            (topics.LEARNER_INFO, forged_learner, "is described differently than before"),
            (topics.POLICY_WEIGHTS, nobodys_weights, "nobody never described itself"),
        ],
    ],
    ids=["arena", "learner"],
)
def test_forged_latched_messages_are_reported_and_learning_continues(probe, strangers) -> None:
    sent = [(probe.speaker(topic), make(probe)) for topic, make, _ in strangers]
    said = [text for _, _, text in strangers]

    def send() -> None:
        for speaker, message in sent:
            speaker.publish(message)

    assert probe.sees(lambda: all(text in probe.message("agent_node") for text in said), send)
    assert probe.health["/agent_node"].level == ERROR
    assert probe.learns()


def test_the_commands_of_a_second_agent_do_not_move_the_arm(probe: Probe) -> None:
    stranger = topics.JOINT_COMMANDS.publisher(probe)

    def answer(features: Any) -> None:
        where = features.episode, features.step, header_stamp(features)
        action = np.ones(6, np.float32)
        stranger.publish(encode_command(Command(*where, "second", 0, action, 1, features.step)))

    answering = topics.OBJECT_FEATURES.subscribe(probe, answer)
    seen = probe.count(topics.OBJECT_FEATURES)
    said = "a second agent is ignored (second/1 sends, too): stop it"
    assert probe.until(lambda: probe.message("sim_node").startswith(said))
    assert probe.health["/sim_node"].level == ERROR
    assert probe.learns()
    probe.destroy_subscription(answering)
    moved_by = {message.commanded_by for message in probe.heard["object_features"][seen:]}
    assert moved_by <= {"", "real"}
    assert probe.until(lambda: probe.message("sim_node") == "running")


def test_the_steps_of_a_second_arena_are_ignored(probe: Probe) -> None:
    arena, agent, _ = probe.nodes
    describes, steps = probe.speaker(topics.ARENA_INFO), topics.OBJECT_FEATURES.publisher(probe)
    describes.publish(encode_arena_info(replace(ARENA, arena_id="second")))

    def repeat(features: Any) -> None:
        if features.arena_id != "second":
            features.arena_id = "second"
            features.features = [0.5] * len(features.features)
            steps.publish(features)

    repeating = topics.OBJECT_FEATURES.subscribe(probe, repeat)
    said = "a second arena is ignored (second sends, too): stop it"
    assert probe.until(lambda: probe.message("agent_node").startswith(said))
    assert probe.health["/agent_node"].level == ERROR
    assert probe.learns() and agent.arena.arena_id == arena.session.arena_id
    probe.destroy_subscription(repeating)
