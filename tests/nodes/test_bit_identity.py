"""Three episodes in lockstep over the graph of real processes end where the loop ends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.evaluation.training import training_programs
from pa_ros.learning.loop import TrainConfig, train
from pa_ros.learning.protocols import protocol_named
from pa_ros.ros import topics
from pa_ros.ros.client import client_node
from pa_ros.ros.graph import start_nodes, use_domain, watch
from pa_ros.ros.launcher import Supervisor
from pa_ros.wire import codec

SEED, EPISODES = 11, 3
OPTIONS = ["learner.warmup_frames=20", "learner.batch_size=16", "network.hidden=32"]


def over_the_graph(folder: Path, eval_every: int) -> dict[str, np.ndarray]:
    """Actor tensors after EPISODES stretches, as three processes learned them."""
    parameters = {
        "sim_node": {"seed": SEED, "eval_every_episodes": eval_every},
        "agent_node": {"learning": True, "seed": SEED, "options": [*OPTIONS]},
        "learner_node": {"seed": SEED, "options": [*OPTIONS]},
    }
    found: dict[str, np.ndarray] = {}

    def receive(message) -> None:
        policy = codec.decode_weights(message)
        if policy.snapshot.version == EPISODES:
            found.update(policy.snapshot.tensors)

    use_domain(None)
    with Supervisor(folder) as supervisor, client_node("watch") as node:
        topic = topics.POLICY_WEIGHTS
        node.create_subscription(topic.type, topic.name, receive, topic.reader)
        start_nodes(supervisor, parameters, folder)
        assert watch(node, supervisor, lambda: None, lambda: bool(found), 90.0)
    return found


def in_process(folder: Path) -> dict[str, np.ndarray]:
    design, arena = design_named("2-L"), preset_named("fast")
    protocol = protocol_named("ours").with_options(OPTIONS)
    learner = train(
        TrainConfig(folder, SEED, EPISODES * 100, evaluate_every_frames=0),
        protocol.network_config(design.vocabulary),
        protocol.learner,
        ReachTask(arena, design, SEED),
        np.array(arena.joint_speed_limits),
        training_programs(design),
    )
    assert learner.counters.updates > 200
    return learner.snapshot(EPISODES).tensors


@pytest.mark.parametrize("eval_every", [0, 1])
def test_the_graph_and_the_loop_learn_the_same_bits(tmp_path, eval_every):
    there = over_the_graph(tmp_path / "graph", eval_every)
    here = in_process(tmp_path / "loop")
    assert list(there) == list(here)
    for name, tensor in here.items():
        assert np.array_equal(there[name], tensor), name
