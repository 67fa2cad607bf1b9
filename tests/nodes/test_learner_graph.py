"""A learner that starts late, stops and resumes, and arenas that it can't learn about."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL, SMALL_LEARNER, begin_run, graph
from helpers.learners import ARENA, trajectory
from learner_node.config import LearnerNodeConfig
from learner_node.node import CHECK_S, LearnerNode
from pa_ros.language import Vocabulary, parse
from pa_ros.learning.folder import claim
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_trajectory
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def test_a_learner_stopped_and_resumed_beside_its_agent_misses_nothing(tmp_path: Path) -> None:
    out = str(tmp_path / "run")
    begin_run(LearnerNodeConfig(**SMALL, out=out))
    run = {"learner_node__out": out, "learner_node__resume": True, **SMALL_LEARNER}
    agent = {"agent_node__learning": True, "agent_node__resend_period_s": 0.5}
    with graph(SimNode, AgentNode, LearnerNode, **agent, **run) as probe:
        version = lambda: int(float(probe.value("learner_node", "version") or 0))  # noqa: E731
        assert probe.until(lambda: version() > 10)
        assert probe.value("learner_node", "engine") == "fused"
        before, learner = version(), probe.nodes.pop()
        learner.executor.remove_node(learner)
        learner.close()
        learner.destroy_node()
        probe.until(lambda: False, 1.0)  # the agent sends what nobody receives, and then waits
        probe.health.pop("/learner_node")
        probe.nodes.append(LearnerNode())
        assert probe.until(lambda: version() > before + 10)
        assert probe.until(lambda: probe.value("learner_node", "missing_trajectories") == "0")
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.value("learner_node", "lost_trajectories") == "0"


UNLEARNABLE: tuple[dict[str, Any], ...] = ({"training_programs": ()}, {"block_count": 2**32 - 1})


def test_a_learner_takes_the_next_arena_after_some_that_it_cannot_learn_about(monkeypatch) -> None:
    """A robot's driver describes itself without programs; and no memory is that large."""
    monkeypatch.setattr("learner_node.node.OTHER_ARENA_S", 0.1)
    with graph(LearnerNode) as probe:
        (learner,), speaker = probe.nodes, probe.speaker(topics.ARENA_INFO)
        for number, wrong in enumerate(UNLEARNABLE):
            strange = replace(ARENA, arena_id=f"strange{number}", **wrong)
            speaker.publish(encode_arena_info(strange))
            assert probe.until(lambda: learner.refusals.total > number)  # noqa: B023
            probe.until(lambda: False, 2 * CHECK_S)
            assert probe.until(lambda: "cannot learn about" in probe.message("learner_node"))
            assert probe.health["/learner_node"].level == ERROR and learner.ended_by is None
        speaker.publish(encode_arena_info(ARENA))
        assert probe.until(lambda: learner.worker is not None)
        probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(trajectory(0)))
        assert probe.until(lambda: float(probe.value("learner_node", "frames") or 0) > 0)


def test_a_learner_waits_a_while_for_an_arena_that_suits_its_checkpoint(tmp_path: Path) -> None:
    begin_run(LearnerNodeConfig(**SMALL, out=str(tmp_path)))
    words = Vocabulary.of(shape=("CUBE",), color=("RED", "BLUE"))
    strange = replace(ARENA, arena_id="strange", world=replace(ARENA.world, vocabulary=words),
                      training_programs=(parse("NEAR(HAND, RED)", words),))  # fmt: skip
    run = {"learner_node__out": tmp_path, "learner_node__resume": True, **SMALL_LEARNER}
    with graph(LearnerNode, **run) as probe:
        speaker = probe.speaker(topics.ARENA_INFO)
        speaker.publish(encode_arena_info(strange))
        assert probe.until(lambda: "cannot learn about" in probe.message("learner_node"))
        speaker.publish(encode_arena_info(ARENA))
        assert probe.until(lambda: "waits for an agent" in probe.message("learner_node"))


def test_a_learner_whose_folder_another_run_uses_ends_with_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "learner_node.main", "--ros-args", "-p", f"out:={tmp_path}"]
    with graph(SimNode) as probe, claim(tmp_path):
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as learner:
            assert probe.until(lambda: learner.poll() is not None)
            errors = learner.communicate()[1]
        assert learner.returncode == 2 and "FATAL" not in errors and ".py" not in errors
        assert errors.splitlines()[-1].startswith("learner_node: [learning.in_use] ")
