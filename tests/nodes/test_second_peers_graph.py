"""A second agent, arena or learner is an ERROR that names it, and is ignored."""

from dataclasses import replace

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL_LEARNER, graph
from helpers.learners import ARENA, trajectory
from learner_node.node import LearnerNode
from pa_ros.ros import topics
from pa_ros.ros.health import ERROR, WARN
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_trajectory
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
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
        assert probe.until(lambda: "refuses trajectories" in probe.message("learner_node"))
        assert probe.health["/learner_node"].level == WARN
        probe.nodes += [SimNode(), AgentNode()]
        assert probe.until(lambda: float(probe.value("learner_node", "frames") or 0) > 100)
        assert learner.worker.run.info.thresholds == ARENA.thresholds
