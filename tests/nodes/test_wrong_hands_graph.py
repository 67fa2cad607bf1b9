"""Others that speak for an agent, an arena or a learner: nothing false is learned, all is said."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers import learners
from helpers.graph import Probe, Witness, begin_run, graph
from helpers.learners import ARENA, trajectory
from learner_node.config import LearnerNodeConfig
from learner_node.node import LearnerNode
from pa_ros.acting.agent import Agent
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.core.experience import AgentKey
from pa_ros.core.published import PublishedPolicy
from pa_ros.language import Vocabulary, parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.ros import topics
from pa_ros.ros.arenas import SILENT_S
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.rivals import GONE_S
from pa_ros.tools.send import ProgramSender
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import (
    decode_trajectory,
    encode_learner_info,
    encode_trajectory,
    encode_weights,
)
from pa_ros.wire.program import ProgramRequest, decode_program_status, encode_program
from pa_ros.wire.step import Command, encode_command
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
    probe.speaker(topics.POLICY_WEIGHTS).publish(encode_weights(weights))
    probe.speaker(topics.LEARNER_INFO).publish(encode_learner_info(LEARNER))


def false_transitions(probe: Probe, witness: Witness) -> list[str]:
    """Of at least ENOUGH trajectories, those that never happened."""
    assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > ENOUGH)
    heard = [decode_trajectory(m, learners.WORLD) for m in probe.heard["trajectories"]]
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
            number = 1 if agent.last_command is None else agent.last_command.command.number + 1
            action = rng.uniform(-1, 1, 6).astype(np.float32)
            where = features.episode, features.step, header_stamp(features)
            forged = Command(*where, "real", 0, action, agent.key.incarnation, number)
            if rng.random() < 0.3:
                stranger.publish(encode_command(forged))

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
            time.sleep(SILENT_S + 1)  # this process stands still: its arena has not gone
            then = probe.count(topics.TRAJECTORIES)
            assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > then + 2)
            arena_id = probe.nodes[0].session.arena_id
            assert probe.nodes[1].arena.arena_id == arena_id
        assert not false_transitions(probe, witness)
        assert probe.until(lambda: probe.message("sim_node") == "running")
        assert probe.until(lambda: probe.message("agent_node") == "acting")


def test_a_strangers_arena_and_experience_do_not_bind_a_learner_against_the_real_ones() -> None:
    strange = replace(ARENA, arena_id="strange", thresholds=(0.5,), control_period=0.7)
    wide = trajectory(0, "stranger")
    wide = replace(wide, objects=np.repeat(wide.objects, 13, axis=1)[:, :64])
    with graph(LearnerNode, agent_node__learning=True) as probe:
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(strange))
        learner = probe.nodes[0]
        assert probe.until(lambda: learner.worker is not None)
        probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(wide))
        assert probe.until(lambda: "refuses trajectories" in probe.message("learner_node"))
        assert probe.health["/learner_node"].level == WARN
        probe.nodes += [SimNode(), AgentNode()]
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        assert probe.until(lambda: float(probe.value("learner_node", "frames")) > 300)
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(strange))  # and later
        assert probe.until(lambda: float(probe.value("learner_node", "frames")) > 600)
        assert probe.until(lambda: probe.message("agent_node") == "acting")


def test_a_learner_waits_a_while_for_an_arena_that_it_can_go_on_in(tmp_path: Path) -> None:
    begin_run(LearnerNodeConfig(out=str(tmp_path)))
    words = Vocabulary.of(shape=("CUBE",), color=("RED", "BLUE"))
    strange = replace(ARENA, arena_id="strange", world=replace(ARENA.world, vocabulary=words),
                      training_programs=(parse("NEAR(HAND, RED)", words),))  # fmt: skip
    given = {"learner_node__out": str(tmp_path), "learner_node__resume": True}
    with graph(LearnerNode, **given) as probe:
        speaker = probe.speaker(topics.ARENA_INFO)
        speaker.publish(encode_arena_info(strange))
        assert probe.until(lambda: "cannot learn about" in probe.message("learner_node"))
        assert probe.health["/learner_node"].level == ERROR
        speaker.publish(encode_arena_info(ARENA))
        assert probe.until(lambda: probe.nodes[0].worker is not None)
        assert probe.until(lambda: "waits for an agent" in probe.message("learner_node"))


def test_two_learners_are_an_alarm_and_agents_follow_one() -> None:
    with graph(SimNode, AgentNode, LearnerNode, agent_node__learning=True) as probe:
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        agent, first = probe.nodes[1].agent, probe.nodes[2].worker.run.info.run_id
        with process("learner_node"):
            assert probe.until(lambda: "not alone on /policy_w" in probe.message("learner_node"))
            assert probe.health["/learner_node"].level == WARN
            assert probe.until(lambda: "other learners run, too" in probe.message("agent_node"))
            time.sleep(GONE_S + 1)  # this process stands still: its learner has not gone
            then = probe.count(topics.TRAJECTORIES)
            assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > then + 10)
            probe.heard["trajectories"].clear()
            assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 10)
            assert {m.run_id for m in probe.heard["trajectories"]} == {first}
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert agent.interrupted == 0


def test_agents_go_on_with_the_learner_that_stays() -> None:
    with graph(SimNode, AgentNode, agent_node__learning=True) as probe:
        with process("learner_node"):
            assert probe.until(lambda: probe.message("agent_node") == "acting")
            probe.nodes.append(LearnerNode())
            assert probe.until(lambda: "other learners run, too" in probe.message("agent_node"))
        run_id = probe.nodes[2].worker.run.info.run_id
        heard = probe.heard["trajectories"]
        assert probe.until(lambda: bool(heard) and heard[-1].run_id == run_id)
        then = probe.count(topics.TRAJECTORIES)
        assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > then + 10)
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.until(lambda: probe.message("learner_node") == "learning")


def test_strangers_that_do_no_harm_are_said_all_the_same() -> None:
    arena = replace(ARENA, arena_id="strange", thresholds=(9.0,), control_period=7.0)
    nobodys = PublishedPolicy(learners.snapshot(9), "nobody's", "nobody")
    with graph(SimNode, AgentNode, LearnerNode, agent_node__learning=True) as probe:
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        for topic, message, said in (
            (topics.ARENA_INFO, encode_arena_info(arena), "another arena describes itself"),
            (topics.POLICY_WEIGHTS, encode_weights(nobodys), "never announced itself"),
        ):
            probe.speaker(topic).publish(message)
            assert probe.until(lambda: said in probe.message("agent_node"))  # noqa: B023
            assert probe.health["/agent_node"].level == WARN
            assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.value("learner_node", "refused.wire.arena_fact") == "1"
        assert probe.until(lambda: probe.message("learner_node") == "learning")


def _weights(shape: list[int], architecture: str = "{}") -> Any:
    message = encode_weights(learners.published(9))
    message.tensors[0].shape = shape
    message.architecture = architecture
    return message


HOSTILE: dict[str, Any] = {
    "65 dimensions": lambda: _weights([1] * 65),
    "an overflowing shape": lambda: _weights([2**32 - 1] * 8),
    "an empty overflowing shape": lambda: _weights([0, 2**32 - 1, 2**32 - 1]),
    "200,000 brackets": lambda: encode_weights(
        replace(
            learners.published(9),
            snapshot=replace(learners.snapshot(9), architecture="[" * 200_000),
        )
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_latched_message_kills_no_agent(name) -> None:
    with graph(SimNode) as probe:
        stranger = probe.create_publisher(
            topics.POLICY_WEIGHTS.type, "policy_weights", topics.POLICY_WEIGHTS.writer
        )
        stranger.publish(HOSTILE[name]())
        probe.nodes.append(AgentNode())
        assert probe.until(lambda: probe.nodes[1].refusals.total > 0)
        codes = set(probe.nodes[1].refusals.counts)
        assert codes <= {"wire.size", "wire.truncated", "learning.policy", "wire.range"}, codes
        announce(probe)
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 20)


def test_a_first_policy_of_another_size_does_not_shut_the_real_learner_out() -> None:
    other = NetworkConfig(world=learners.WORLD, hidden=4, attention=2)
    strange = PublishedPolicy(learners.snapshot(9, other), "strange", "stranger")
    with graph(SimNode, AgentNode) as probe:
        agent = probe.nodes[1].agent
        speaker = probe.speaker(topics.POLICY_WEIGHTS)
        speaker.publish(encode_weights(strange))
        assert probe.until(lambda: agent.has_weights and agent.version == 9)
        speaker.publish(encode_weights(learners.published(1)))
        assert probe.until(lambda: probe.value("agent_node", "refused.learning.policy") == "1")
        probe.speaker(topics.LEARNER_INFO).publish(encode_learner_info(LEARNER))
        assert probe.until(lambda: agent.version == 1)
        speaker.publish(encode_weights(strange))
        assert probe.until(lambda: probe.value("agent_node", "refused.learning.policy") == "2")
        assert probe.until(lambda: probe.last(topics.JOINT_COMMANDS).policy_version == 1)


def test_a_program_that_the_networks_cannot_be_told_stops_no_training() -> None:
    given = {"agent_node__weights": "random", "agent_node__network": "canonical"}
    with graph(SimNode, AgentNode, **given) as probe:
        assert probe.until(lambda: probe.count(topics.JOINT_COMMANDS) > 10)
        probe.speaker(topics.PROGRAM).publish(
            encode_program(ProgramRequest("red", "NEAR(HAND, RED)"))
        )
        assert probe.until(lambda: "holds the arm" in probe.message("agent_node"))
        assert probe.health["/agent_node"].level == WARN
        answers = map(decode_program_status, probe.heard["program_status"])
        assert {a.node: a.accepted for a in answers if a.program_id == "red"} == {
            "/sim_node": True, "/agent_node": False,
        }  # fmt: skip
        held = [m for m in probe.heard["joint_commands"] if not any(m.action)]
        assert held
        assert probe.until(lambda: probe.message("agent_node") == "acting")  # the next episode
        assert probe.health["/agent_node"].level == OK


def test_an_id_has_one_meaning_for_arena_and_agent() -> None:
    with graph(SimNode, AgentNode, agent_node__weights="random") as probe:
        arena_id = probe.nodes[0].session.arena_id
        speaker = probe.speaker(topics.PROGRAM)

        def ask(program_id: str, text: str) -> dict[str, bool]:
            probe.heard["program_status"].clear()
            speaker.publish(encode_program(ProgramRequest(program_id, text)))
            found: dict[str, bool] = {}

            def answered() -> bool:
                for one in map(decode_program_status, probe.heard["program_status"]):
                    found.update({one.node: one.accepted} if one.program_id == program_id else {})
                return "/sim_node" in found

            assert probe.until(answered)
            probe.until(lambda: False, 0.3)
            answered()
            return found

        assert ask("mine", "NEAR(HAND, RED)") == {"/sim_node": True, "/agent_node": True}
        assert ask("mine", "NEAR(HAND, BLUE)") == {"/sim_node": False, "/agent_node": False}
        assert probe.nodes[0].refusals.counts["program.id_taken"] == 1
        unused = f"{arena_id}/train/{10**6}"  # in lockstep the first episodes are soon past
        assert ask(unused, "NEAR(HAND, BLUE)")["/sim_node"] is False
        meanings = {(m.program_id, m.program) for m in probe.heard["object_features"]}
        assert len({one for one, _ in meanings}) == len(meanings)
        assert ("mine", "NEAR(HAND, RED)") in meanings


@pytest.mark.parametrize("held_from", [0, 10**6])
def test_a_trajectory_far_ahead_under_a_real_agents_name_stops_nothing(held_from) -> None:
    with graph(SimNode, AgentNode, LearnerNode, **LEARNING) as probe:
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        agent = probe.nodes[1].agent
        key = agent.key
        forged = replace(
            trajectory(10**6, "real"), incarnation=key.incarnation, held_from=held_from
        )
        probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(forged))
        if held_from:
            assert probe.until(lambda: probe.value("learner_node", "lost_trajectories") != "0")
            assert probe.until(lambda: "under this agent's name" in probe.message("agent_node"))
        else:
            refused = "refused.learning.ahead"
            assert probe.until(lambda: probe.value("learner_node", refused) == "1")
            assert probe.until(lambda: "someone else send" in probe.message("learner_node"))
        then = float(probe.value("learner_node", "frames"))
        assert probe.until(lambda: float(probe.value("learner_node", "frames")) > then + 1000)
        assert len(agent.unaccounted) < 5
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.until(lambda: probe.message("learner_node") == "learning")


def test_an_agent_of_a_fixed_name_that_starts_again_is_learned_from() -> None:
    with graph(SimNode, LearnerNode) as probe:
        for _ in range(2):
            before = float(probe.value("learner_node", "frames") or 0)
            with process("agent_node", "learning:=true", "agent_id:=fixed"):
                more = lambda: float(probe.value("learner_node", "frames") or 0) > before + 500  # noqa: B023, E731
                assert probe.until(more)
            assert probe.until(lambda: "no trajectory for" in probe.message("learner_node"))
            assert probe.health["/learner_node"].level == WARN
        assert probe.value("learner_node", "duplicate_trajectories") == "0"


def test_what_a_stranger_garbles_ends_nobody_who_sends_a_program() -> None:
    garbled = (topics.VERDICT, {"distance": float("nan")}), (topics.PROGRAM_STATUS, {"status": 7})
    with graph() as probe:
        sender = ProgramSender(probe, probe.until)
        for topic, fields in garbled:
            probe.speaker(topic).publish(topic.type(**fields))
        assert probe.until(lambda: sender.refusals.counts == {"wire.range": 2})
