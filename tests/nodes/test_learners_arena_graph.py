"""Arenas that a learner cannot learn about, and what it does then."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from helpers.graph import graph
from helpers.learners import ARENA, trajectory
from learner_node.node import CHECK_S, LearnerNode
from pa_ros.learning.folder import claim
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_trajectory
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
UNLEARNABLE: tuple[dict[str, Any], ...] = ({"training_programs": ()}, {"block_count": 2**32 - 1})


def test_a_learner_takes_the_next_arena_after_some_that_it_cannot_learn_about(monkeypatch) -> None:
    """As a robot's driver describes itself, without programs; and one of no memory's size."""
    monkeypatch.setattr("learner_node.node.OTHER_ARENA_S", 0.1)
    with graph(LearnerNode) as probe:
        learner, speaker = probe.nodes[0], probe.speaker(topics.ARENA_INFO)
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
        assert probe.until(lambda: learner.worker.metrics["frames"] > 0)


def test_a_learner_whose_folder_another_writes_into_ends_with_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "learner_node.main", "--ros-args", "-p", f"out:={tmp_path}"]
    with graph(SimNode) as probe, claim(tmp_path):
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as learner:
            assert probe.until(lambda: learner.poll() is not None)
            errors = learner.communicate()[1]
        assert learner.returncode == 2 and "FATAL" not in errors and ".py" not in errors
        assert errors.splitlines()[-1].startswith("learner_node: [learning.in_use] ")
