"""With a key, strangers are refused and counted, and the graph goes on as if nothing was."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from agent_node.node import AgentNode
from benchmarks.samples import sample_step
from helpers.graph import Probe, graph
from helpers.learners import LEARNER, published, trajectory
from learner_node.node import LearnerNode
from pa_ros.ros import topics
from pa_ros.ros.environment import LOOPBACK_PROFILE
from pa_ros.wire.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.learning import encode_learner_info, encode_trajectory, encode_weights
from pa_ros.wire.signing import Signer, SigningError
from pa_ros.wire.step import encode_command
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
KEY = b"a key of thirty-two bytes, or so."
NODES = SimNode, AgentNode, LearnerNode
GIVEN = {
    "agent_node__learning": True,
    "agent_node__resend_period_s": 0.5,
    "learner_node__learner.replay.warmup_frames": 20,
    "learner_node__learner.replay.batch_size": 8,
    "learner_node__network.hidden": 16,
    "learner_node__learner.schedule.trajectory_steps": 10,
}
STRANGERS = {
    "joint_commands": (topics.JOINT_COMMANDS, lambda: encode_command(sample_step()[2])),
    "trajectories": (topics.TRAJECTORIES, lambda: encode_trajectory(trajectory(0, "x"))),
    "policy_weights": (topics.POLICY_WEIGHTS, lambda: encode_weights(published(9))),
    "learner_info": (
        topics.LEARNER_INFO,
        lambda: encode_learner_info(replace(LEARNER, stamp_ns=2**62)),
    ),
}
HEARD_BY = {"joint_commands": "sim_node", "trajectories": "learner_node"}


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    return path


def keyed(key: Path) -> dict[str, object]:
    return {**GIVEN, **{f"{n}__auth_key_file": key for n in ("sim_node", "agent_node",
                                                             "learner_node")}}  # fmt: skip


def learns_on(probe: Probe) -> bool:
    version = float(probe.value("learner_node", "version") or 0)
    return probe.until(lambda: float(probe.value("learner_node", "version") or 0) > version + 5)


@pytest.mark.parametrize("name", STRANGERS)
def test_strangers_are_refused_and_counted_and_learning_goes_on(name, key):
    topic, make = STRANGERS[name]
    node = HEARD_BY.get(name, "agent_node")
    with graph(*NODES, **keyed(key)) as probe:
        assert learns_on(probe)
        real = probe.last(topic)
        speaker = probe.speaker(topic)
        speaker.publish(make())
        assert probe.until(lambda: probe.value(node, "refused.auth.unsigned") == "1")
        speaker.publish(Signer(b"another key" * 3, "/learner_node", 2**62).sign(make()))
        assert probe.until(lambda: probe.value(node, "refused.auth.forged") == "1")
        speaker.publish(real)
        assert probe.until(lambda: probe.value(node, "refused.auth.replayed") == "1")
        assert learns_on(probe)


def test_a_strangers_arena_is_refused_by_agents_and_learner(key):
    with graph(*NODES, **keyed(key)) as probe:
        assert learns_on(probe)
        arena = decode_arena_info(probe.last(topics.ARENA_INFO))
        strange = encode_arena_info(replace(arena, arena_id="strange"))
        probe.speaker(topics.ARENA_INFO).publish(strange)
        refused = "refused.auth.unsigned"
        assert probe.until(lambda: probe.value("agent_node", refused) == "1")
        assert probe.until(lambda: probe.value("learner_node", refused) == "1")
        assert learns_on(probe)


def test_a_key_that_others_can_read_is_refused_by_name(key):
    key.chmod(0o644)
    with pytest.raises(SigningError, match=f"{key}: expected a file that only its owner can read"):
        with graph(SimNode, sim_node__auth_key_file=key):
            pass


def test_with_and_without_a_key_do_not_work_together(key):
    parameters = {k: v for k, v in keyed(key).items() if k != "agent_node__auth_key_file"}
    with graph(*NODES, **parameters) as probe:
        assert probe.until(lambda: int(probe.value("sim_node", "refused.auth.unsigned") or 0) > 0)
        assert probe.value("learner_node", "version") in ("", "0")


FORGE = """
import os
from benchmarks.samples import sample_step
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
message = encode_command(sample_step()[2])
import rclpy, rclpy.experimental.events_executor
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
with client_node("stranger") as node:
    publisher = topics.JOINT_COMMANDS.publisher(node)
    assert spin_until(node, lambda: publisher.get_subscription_count() > 0, 60.0)
    publisher.publish(message)
    spin_until(node, lambda: False, 2.0)
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_user_of_this_host_is_heard_but_not_believed(key, tmp_path):
    """DDS on loopback knows no users: the signature does."""
    profile = Path(tempfile.mkdtemp(prefix="pa_ros-")) / "loopback.xml"
    profile.write_bytes(LOOPBACK_PROFILE.read_bytes())
    profile.parent.chmod(0o777)
    environment = {**os.environ, "HOME": str(profile.parent), "PYTHONDONTWRITEBYTECODE": "1",
                   "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}  # fmt: skip
    with graph(*NODES, **keyed(key)) as probe:
        assert learns_on(probe)
        with subprocess.Popen([sys.executable, "-c", FORGE], env=environment) as stranger:
            try:
                assert probe.until(
                    lambda: (
                        stranger.poll() is not None
                        or probe.value("sim_node", "refused.auth.unsigned") == "1"
                    )
                )
                if stranger.poll():
                    pytest.skip("another user cannot read this environment's libraries")
                assert probe.until(lambda: probe.value("sim_node", "refused.auth.unsigned") == "1")
            finally:
                stranger.kill()
                shutil.rmtree(profile.parent)
        assert learns_on(probe)
