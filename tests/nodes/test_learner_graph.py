"""A learner that starts late, stops and resumes; and others, of which it can learn nothing."""

import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL, SMALL_LEARNER, begin_run, graph
from helpers.learners import ARENA, trajectory
from helpers.pushing import PROGRAMS, PUSH
from learner_node.config import LearnerNodeConfig
from learner_node.node import LearnerNode
from pa_ros.learning.folder import claim
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_trajectory
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def test_a_learner_resumed_beside_its_agent_loses_no_trajectory(tmp_path: Path) -> None:
    out = str(tmp_path / "run")
    begin_run(LearnerNodeConfig(**SMALL, out=out))
    run = {"learner_node__out": out, "learner_node__resume": True, **SMALL_LEARNER}
    agent = {"agent_node__learning": True, "agent_node__resend_period_s": 0.5}
    with graph(SimNode, AgentNode, LearnerNode, **agent, **run) as probe:
        version = lambda: int(float(probe.value("learner_node", "version") or 0))  # noqa: E731
        assert probe.until(lambda: version() > 10)
        assert probe.value("learner_node", "engine") == "fused"
        before = version()
        probe.end(probe.nodes[-1])
        probe.until(lambda: False, 1.0)  # the agent sends what nobody receives, and then waits
        probe.health.pop("/learner_node")
        probe.nodes.append(LearnerNode())
        assert probe.until(lambda: version() > before + 10)
        assert probe.until(lambda: probe.value("learner_node", "missing_trajectories") == "0")
        assert probe.until(lambda: probe.message("learner_node") == "learning")
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.value("learner_node", "lost_trajectories") == "0"


def test_a_learner_takes_the_next_arena_after_one_that_it_cannot_learn_about() -> None:
    """A robot's driver describes itself without training programs."""
    with graph(LearnerNode) as probe:
        (learner,), speaker = probe.nodes, probe.speaker(topics.ARENA_INFO)
        driver = replace(ARENA, arena_id="driver", training_programs=())
        speaker.publish(encode_arena_info(driver))
        assert probe.until(lambda: "cannot learn about" in probe.message("learner_node"))
        assert probe.health["/learner_node"].level == ERROR and learner.ended_by is None
        speaker.publish(encode_arena_info(ARENA))
        assert probe.until(lambda: learner.worker is not None)
        probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(trajectory(0)))
        assert probe.until(lambda: float(probe.value("learner_node", "frames") or 0) > 0)
        assert "weights version 1" in learner.progress()
        reward = trajectory(0).rewards.mean()
        assert f"reward/step {reward:+.3f}" in learner.progress()
        assert "updates 0 (the first after 5,000 frames)" in learner.progress()
        assert probe.value("learner_node", "reward_per_step") == f"{reward:.6g}"


@pytest.mark.parametrize("named", [{}, {"learner_node__recipe": "''"}])
def test_the_recipe_is_the_arenas_unless_one_is_named(named: dict[str, str]) -> None:
    pushing = replace(ARENA, world=PUSH, training_programs=(PROGRAMS[0],))
    given = {"learner_node__learner.replay.batch_size": 64}  # as in `ours`, but `push` has another
    with graph(LearnerNode, **given, **named) as probe:
        (learner,), speaker = probe.nodes, probe.speaker(topics.ARENA_INFO)
        follows = lambda recipe: learner.config.recipe == recipe  # noqa: E731
        for arena, recipe, discount in ((pushing, "push", 0.97), (ARENA, "ours", 0.95)):
            speaker.publish(encode_arena_info(replace(arena, arena_id=recipe)))
            assert probe.until(partial(follows, recipe))
            shown = {name: learner.get_parameter(name).value for name in learner.config.flat()}
            assert (shown["recipe"], shown["learner.updates.discount"]) == (recipe, discount)
            assert shown["learner.replay.batch_size"] == 64
            origin = learner.worker.origin("learner_node")
            assert origin.parameters["recipe"] == recipe


def test_a_learner_ends_with_one_line_if_another_run_uses_its_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "learner_node.main", "--ros-args", "-p", f"out:={tmp_path}"]
    with graph(SimNode) as probe, claim(tmp_path):
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as learner:
            assert probe.until(lambda: learner.poll() is not None)
            errors = learner.communicate()[1]
        assert learner.returncode == 2 and "FATAL" not in errors and ".py" not in errors
        assert errors.splitlines()[-1].startswith("learner_node: [learning.in_use] ")


LEARNING = {
    "sim_node__resend_period_s": 0.2,
    "agent_node__resend_period_s": 0.5,
    "agent_node__learning": True,
    "agent_node__agent_id": "real",
    **SMALL_LEARNER,
}


def test_the_second_learner_is_followed_after_the_first_one_ends() -> None:
    with graph(SimNode, AgentNode, LearnerNode, **LEARNING) as probe:
        trajectories = probe.heard["trajectories"]
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        first, second = probe.nodes[2], LearnerNode()
        run_id = trajectories[-1].run_id
        probe.nodes.append(second)
        said = "a second learner is ignored ("
        assert probe.until(lambda: probe.message("agent_node").startswith(said))
        assert probe.health["/agent_node"].level == ERROR
        assert {m.run_id for m in trajectories} == {run_id}
        probe.end(first)
        assert probe.until(lambda: trajectories[-1].run_id == second.worker.run.info.run_id)
        assert probe.until(lambda: probe.message("agent_node") == "acting")
        assert probe.until(lambda: probe.message("learner_node") == "learning")


def test_a_learner_leaves_a_strangers_arena_for_the_real_one() -> None:
    strange = replace(ARENA, arena_id="strange", thresholds=(0.5,), control_period=0.7)
    wide = trajectory(0, "stranger")
    wide = replace(wide, objects=np.repeat(wide.objects, 13, axis=1)[:, :64])
    with graph(LearnerNode, **LEARNING) as probe:
        (learner,) = probe.nodes
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(strange))
        assert probe.until(lambda: learner.worker is not None)
        probe.speaker(topics.TRAJECTORIES).publish(encode_trajectory(wide))
        # Counted for good; the message about it passes, and a busy machine may miss it.
        assert probe.until(lambda: probe.value("learner_node", "refused.learning.size") == "1")
        probe.nodes += [SimNode(), AgentNode()]
        assert probe.until(lambda: float(probe.value("learner_node", "frames") or 0) > 100)
        assert learner.worker.run.info.thresholds == ARENA.thresholds
