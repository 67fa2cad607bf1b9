"""learner_node's scalars for TensorBoard."""

from __future__ import annotations

import pytest

from helpers.graph import graph
from helpers.learners import ARENA, trajectory
from learner_node.node import LearnerNode
from pa_ros.ros import topics
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_trajectory


@pytest.mark.graph
def test_a_learner_writes_them_at_its_end_too(tmp_path) -> None:
    pytest.importorskip("tensorboard")
    with graph(LearnerNode, learner_node__tensorboard=tmp_path / "events") as probe:
        probe.speaker(topics.ARENA_INFO).publish(encode_arena_info(ARENA))
        learner = probe.nodes[0]
        assert probe.until(lambda: learner.worker is not None)
        sent = probe.speaker(topics.TRAJECTORIES)
        sent.publish(encode_trajectory(trajectory(0)))
        assert probe.until(lambda: learner.worker.metrics["frames"] > 0)
    (events,) = (tmp_path / "events").iterdir()
    assert b"learner/updates" in events.read_bytes()
