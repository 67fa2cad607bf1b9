"""With a signing key, unsigned, forged and replayed messages are refused. One graph for all."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SMALL_LEARNER, Probe, graph
from helpers.learners import ARENA, LEARNER, published, trajectory
from laboratory.benchmarks.samples import sample_step
from learner_node.node import LearnerNode
from pa_ros.ros import topics
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.learning import encode_learner_info, encode_trajectory, encode_weights
from pa_ros.wire.signing import Signer
from pa_ros.wire.step import Command, encode_command, encode_step
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
KEY = b"a key of thirty-two bytes, or so."
COMMAND = Command(0, 0, 1, "x", 0, np.zeros(6, np.float32))
FEATURES = encode_step(replace(sample_step()[0], arena_id="x"))
LATER = replace(LEARNER, stamp_ns=2**62)
STRANGERS = [
    (topics.OBJECT_FEATURES, lambda: deepcopy(FEATURES), "agent_node"),
    (topics.JOINT_COMMANDS, lambda: encode_command(COMMAND), "sim_node"),
    (topics.TRAJECTORIES, lambda: encode_trajectory(trajectory(0, "x")), "learner_node"),
    (topics.POLICY_WEIGHTS, lambda: encode_weights(published(9)), "agent_node"),
    (topics.LEARNER_INFO, lambda: encode_learner_info(LATER), "agent_node"),
    (topics.ARENA_INFO, lambda: encode_arena_info(replace(ARENA, arena_id="x")), "learner_node"),
]


@pytest.fixture(scope="module")
def probe(module_domain: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Probe]:
    path = tmp_path_factory.mktemp("key") / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    nodes = ("sim_node", "agent_node", "learner_node")
    keys = {f"{node}__auth_key_file": path for node in nodes}
    learning = {"agent_node__learning": True, **SMALL_LEARNER}
    with graph(SimNode, AgentNode, LearnerNode, **learning, **keys) as probe:
        assert probe.learns()
        yield probe


@pytest.mark.parametrize(("topic", "make", "node"), STRANGERS, ids=lambda x: getattr(x, "name", ""))
def test_messages_without_the_key_are_refused_and_learning_continues(probe, topic, make, node):
    counts = {one.get_name(): one.refusals for one in probe.nodes}[node]
    real = probe.last(topic)
    speaker = probe.speaker(topic)
    forged = Signer(b"another key" * 3, "/learner_node", 2**62).sign(speaker.topic_name, make())
    carried = Signer(KEY, "/learner_node", 2**62).sign(f"/elsewhere/{topic.name}", make())
    for message, code in (
        (make(), "auth.unsigned"),
        (forged, "auth.forged"),
        (carried, "auth.forged"),
        (real, "auth.replayed"),
    ):
        before = counts.counts[code]
        speaker.publish(message)
        assert probe.until(lambda: counts.counts[code] > before)  # noqa: B023
    refused = lambda: "without a valid signature" in probe.message(node)  # noqa: E731
    assert probe.sees(refused, lambda: speaker.publish(real))
    assert probe.learns()
