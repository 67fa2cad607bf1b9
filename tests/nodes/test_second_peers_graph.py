"""A second agent, arena or learner is an ERROR that names it, and is ignored."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL_LEARNER, Witness, graph
from helpers.learners import ARENA, WORLD, trajectory
from learner_node.node import LearnerNode
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import decode_trajectory, encode_trajectory
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
LEARNING = {"agent_node__learning": True, "agent_node__agent_id": "real", **SMALL_LEARNER}


@contextmanager
def process(node: str, *parameters: str) -> Iterator[None]:
    """A node in its own process, killed at the end."""
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    with subprocess.Popen([sys.executable, "-m", f"{node}.main", "--ros-args", *arguments]) as one:
        try:
            yield
        finally:
            one.kill()


def test_the_commands_of_a_second_agent_move_nothing() -> None:
    given = {"agent_node__agent_id": "real", "agent_node__weights": "random"}
    with graph(SimNode, AgentNode, **given) as probe:
        assert probe.until(lambda: probe.message("sim_node") == "running")
        with process("agent_node", "weights:=random", "agent_id:=second"):
            said = "a second agent is ignored (second/"
            assert probe.until(lambda: probe.message("sim_node").startswith(said))
            assert probe.health["/sim_node"].level == ERROR
        assert {m.commanded_by for m in probe.heard["object_features"]} <= {"", "real"}
        assert probe.until(lambda: probe.message("sim_node") == "running")
        assert probe.message("agent_node") == "acting"
        assert probe.health["/agent_node"].level == probe.health["/sim_node"].level == OK


def test_the_steps_of_a_second_arena_are_not_joined_with_the_firsts() -> None:
    with graph(SimNode, AgentNode, LearnerNode, **LEARNING) as probe:
        arena, agent, _ = probe.nodes
        witness = Witness(arena.session)
        assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > 2)
        with process("sim_node", "seed:=5"):
            assert probe.until(lambda: "sends, too): stop it" in probe.message("agent_node"))
            assert probe.message("agent_node").startswith("a second arena is ignored (")
            assert probe.health["/agent_node"].level == ERROR
            then = probe.count(topics.TRAJECTORIES)
            assert probe.until(lambda: probe.count(topics.TRAJECTORIES) > then + 2)
            assert agent.arena.arena_id == arena.session.arena_id
        learned = [decode_trajectory(m, WORLD) for m in probe.heard["trajectories"]]
        assert not witness.false(learned)
        assert probe.until(lambda: probe.message("agent_node") == "acting")


def test_of_two_learners_the_first_is_followed_and_then_the_one_that_stays() -> None:
    with graph(SimNode, AgentNode, **LEARNING) as probe:
        trajectories = probe.heard["trajectories"]
        with process("learner_node"):
            assert probe.until(lambda: probe.message("agent_node") == "acting")
            first = trajectories[-1].run_id
            second = LearnerNode()
            probe.nodes.append(second)
            said = "a second learner is ignored ("
            assert probe.until(lambda: probe.message("agent_node").startswith(said))
            assert probe.health["/agent_node"].level == ERROR
            assert {m.run_id for m in trajectories} == {first}
        assert probe.until(lambda: trajectories[-1].run_id == second.worker.run.info.run_id)
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.until(lambda: probe.message("learner_node") == "learning")


def test_a_strangers_arena_and_experience_do_not_bind_a_learner_against_the_real_ones() -> None:
    strange = replace(ARENA, arena_id="strange", thresholds=(0.5,), control_period=0.7)
    wide = trajectory(0, "stranger")
    wide = replace(wide, objects=np.repeat(wide.objects, 13, axis=1)[:, :64])
    with graph(LearnerNode, **LEARNING) as probe:
        (learner,) = probe.nodes
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(strange))
        assert probe.until(lambda: learner.worker is not None)
        probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(wide))
        assert probe.until(lambda: "refuses trajectories" in probe.message("learner_node"))
        assert probe.health["/learner_node"].level == WARN
        probe.nodes += [SimNode(), AgentNode()]
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        assert probe.until(lambda: float(probe.value("learner_node", "frames")) > 300)
        assert probe.until(lambda: probe.message("agent_node") == "acting")
