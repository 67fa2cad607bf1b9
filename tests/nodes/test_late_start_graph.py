"""Nodes that start late or one by one: earlier programs, an arena that waits, parameter files."""

import re
import shutil
import sys
from pathlib import Path

import pytest

from agent_node.node import AgentNode
from helpers.graph import REPEATED, graph
from helpers.processes import running
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.ros import topics
from pa_ros.tools.send import ProgramSender
from pa_ros.wire.program import ProgramRequest, decode_program_status, encode_program
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
ANY = "OR(AND(RED, CUBE), AND(RED, SPHERE), AND(BLUE, CUBE), AND(BLUE, SPHERE))"


def test_a_late_agent_accepts_the_first_steps_program_although_another_replaced_it() -> None:
    """Else the agent waits for it for ever, and a lockstep arena for the agent."""
    with graph(SimNode, agent_node__weights="random") as probe:
        request = ProgramRequest("user/1", f"NEAR(HAND, {ANY})")
        probe.speaker(topics.PROGRAM).publish(encode_program(request))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > 0)
        assert decode_program_status(probe.last(topics.PROGRAM_STATUS)).accepted
        probe.nodes.append(AgentNode())
        assert probe.reaches(5)
        # A busy probe may look only after the next episode began, which has another program.
        first = [m for m in probe.heard["object_features"] if m.episode == 0 and m.step > 0]
        assert first and {m.program_id for m in first} == {"user/1"}


def test_a_program_outlives_its_sender() -> None:
    """Published as `ros2 topic pub` does, for those who are there; then an agent comes."""
    with graph(SimNode, agent_node__weights="random", sim_node__program_source="topic") as probe:
        name, plain = topics.PROGRAM.name, topics.PROGRAM.reader
        sender = probe.create_publisher(topics.PROGRAM.type, name, plain)
        assert probe.until(lambda: sender.get_subscription_count() >= 1)
        request = ProgramRequest("user/1", "NEAR(HAND, OR(OR(RED, BLUE), CUBE))")
        sender.publish(encode_program(request))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > 0)
        probe.nodes.append(AgentNode())
        assert probe.reaches(5)
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) == 2)
        assert decode_program_status(probe.last(topics.PROGRAM_STATUS)).node == "/agent_node"
        sender.publish(encode_program(request))  # sent again, both answer again
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) == 4)


def test_an_arena_that_starts_paused_publishes_no_steps_until_resumed() -> None:
    with graph(SimNode, AgentNode, agent_node__weights="random", sim_node__paused=True) as probe:
        assert probe.until(lambda: probe.message("sim_node") != "")
        assert probe.until(lambda: probe.value("agent_node", "refused") != "")
        assert probe.until(lambda: probe.count(topics.ARENA_INFO) == 1)
        arena = probe.nodes[0]
        (steps,) = (p for p in arena.publishers if p.topic_name == "/object_features")
        assert probe.until(lambda: steps.get_subscription_count() == 2)  # the agent and the probe
        assert probe.count(topics.OBJECT_FEATURES) == 0
        assert probe.pause(False).success
        assert probe.reaches(3)
        heard = dict.fromkeys(m.step for m in probe.heard["object_features"])
        assert list(heard)[:3] == [0, 1, 2] and arena.refusals.counts.keys() <= REPEATED


def test_nodes_receive_a_program_that_was_sent_before_they_started() -> None:
    with graph(sim_node__program_source="topic", agent_node__weights="random") as probe:
        starting = [SimNode, AgentNode]

        def spin(condition, timeout_s: float) -> bool:
            assert not probe.until(condition, 1.5)
            probe.nodes = [make() for make in starting]
            return probe.until(condition, timeout_s)

        sender = ProgramSender(probe, spin)
        try:
            answers = sender.send("NEAR(HAND, OR(OR(RED, BLUE), CUBE))", DEADLINE_S)
        finally:
            made, probe.nodes = probe.nodes, []
            for node in made:
                node.executor.remove_node(node)
                node.destroy_node()
        assert set(answers.statuses) == {"/sim_node", "/agent_node"} and not answers.refused


ROOT = Path(__file__).parents[2]


def test_three_nodes_started_as_the_docs_show_learn_and_save(tmp_path: Path) -> None:
    """Each with `learn.yaml` of its `config` folder, as in docs/graph.md."""
    commands = []
    for name in ("sim_node", "agent_node", "learner_node"):
        file = f"{name}/config/learn.yaml"
        (tmp_path / file).parent.mkdir(parents=True)
        shutil.copy(ROOT / file, tmp_path / file)
        program = str(Path(sys.executable).with_name(name))
        commands.append([program, "--ros-args", "--params-file", file])
    learning = re.compile(r"\]: learning$", re.MULTILINE)
    with running(tmp_path, *commands, cwd=tmp_path) as (sim, agent, learner):
        wait_for(lambda: learning.search(learner.read_text()), "a learner that learns")
        wait_for(lambda: "acting" in agent.read_text(), "an agent that acts")
    assert "design 2-L" in sim.read_text()
    assert "checkpoint: version " in learner.read_text()
    assert (tmp_path / "runs/learn/checkpoint/LATEST").exists()
