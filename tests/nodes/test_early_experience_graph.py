"""Experience that reaches a learner before an arena has described itself."""

from __future__ import annotations

import pytest

from helpers.graph import graph
from helpers.learners import ARENA, trajectory
from learner_node import node
from learner_node.node import LearnerNode
from pa_ros.ros import topics
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_trajectory

pytestmark = pytest.mark.graph


def test_it_is_kept_in_order_up_to_a_bound_and_beyond_it_refused(
    tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(node, "EARLY_TRAJECTORIES", 3)
    with graph(LearnerNode, learner_node__out=tmp_path / "run") as probe:
        learner = probe.nodes[0]
        sent = probe.speaker(topics.TRAJECTORIES)
        for number in range(5):
            sent.publish(encode_trajectory(trajectory(number)))
        assert probe.until(lambda: learner.refusals.counts["learner.early"] == 2)
        assert learner.refusals.total == 2 and learner.worker is None
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(ARENA))
        frames = 3 * 10
        assert probe.until(
            lambda: learner.worker is not None and learner.worker.metrics["frames"] == frames
        )
        assert learner.refusals.total == 2
        sent.publish(encode_trajectory(trajectory(3)))  # sent again, it is taken
        assert probe.until(lambda: learner.worker.metrics["frames"] == frames + 10)


@pytest.mark.parametrize("engine", ["fused", "torch"])
def test_a_learner_says_what_makes_its_updates(engine, tmp_path) -> None:
    asked = f"['learner.engine.name={engine}']"
    with graph(LearnerNode, learner_node__out=tmp_path, learner_node__options=asked) as probe:
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(ARENA))
        assert probe.until(lambda: probe.value("learner_node", "engine") == engine)
