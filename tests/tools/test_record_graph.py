"""A recording contains what was published, for readers that know nothing of this project."""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import Reader

from helpers.messages import observation
from helpers.processes import pa_ros
from helpers.recordings import decoded, publisher_heard
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.bags.errors import BagError
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.cli.main import main
from pa_ros.core.experience import Step
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.topics import best_effort
from pa_ros.tools.client import client_node
from pa_ros.tools.record import BAG_TOPICS, Recorder, SequenceGaps, topics_named
from pa_ros.wire.definitions import installed_types, message_type
from pa_ros.wire.diagnostics import Health, Origin, encode_diagnostics, encode_provenance
from pa_ros.wire.program import (
    GoalProgress,
    ProgramRequest,
    encode_goal_feedback,
    encode_program,
)
from pa_ros.wire.step import encode_joints, encode_step

pytestmark = pytest.mark.graph
REQUEST = encode_program(ProgramRequest("id", "NEAR(HAND, RED)"))
ORIGIN = Origin("/x", "1", "0", "v", 7, {})


def information(bag: Path) -> dict:
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    return content["rosbag2_bagfile_information"]


def test_decoded_messages_equal_the_published_ones(tmp_path):
    features = encode_step(Step(observation()))
    joints = encode_joints(observation(), tuple("abcdef"))
    sent = [
        (topics.OBJECT_FEATURES, features),
        (topics.JOINT_STATES, joints),
        (topics.DIAGNOSTICS, encode_diagnostics([Health("/x", 1, "hi", {"a": "b"})], 5)),
        (topics.PROGRAM, REQUEST),
        (topics.PROVENANCE, encode_provenance(ORIGIN)),
    ]
    with client_node("test") as node:
        with Recorder(tmp_path / "bag", node) as recorder:
            publishers = [publisher_heard(node, topic) for topic, _ in sent]
            for publisher, (_, message) in zip(publishers, sent, strict=True):
                publisher.publish(message)
            wait_for(lambda: sum(recorder.counts.values()) >= 5, "five messages")
    found = dict(decoded(tmp_path / "bag"))
    assert list(found["/object_features"].features) == list(features.features)
    assert found["/object_features"].header.stamp.nanosec == 300_000_001
    assert found["/joint_states"].name == list("abcdef")
    assert list(found["/joint_states"].velocity) == list(joints.velocity)
    assert found["/program"].text == "NEAR(HAND, RED)"
    assert found["/diagnostics"].status[0].values[0].value == "b"
    custom = information(tmp_path / "bag")["custom_data"]
    assert set(json.loads(custom["pa_ros.lost"]).values()) == {0}


def test_the_feedback_of_an_action_is_recorded(tmp_path):
    name = f"{EXECUTE_PROGRAM[0]}/_action/feedback"
    progress = GoalProgress(0.25, False, ("hand",), (0.5,), policy_version=7)
    sent = EXECUTE_PROGRAM[1].Impl.FeedbackMessage(feedback=encode_goal_feedback(progress))
    sent.goal_id.uuid = np.arange(16, dtype=np.uint8)
    with client_node("test") as node:
        publisher = node.create_publisher(type(sent), name, 10)
        with Recorder(tmp_path / "bag", node, topics_named(node, [name])) as recorder:
            wait_for(publisher.get_subscription_count, "the recorder")
            publisher.publish(sent)
            wait_for(lambda: sum(recorder.counts.values()), "a message")
    with Bag(tmp_path / "bag") as bag:
        found: Any
        (found,) = map(bag.deserialize, bag.messages())
    assert (found.goal_id.uuid[15], found.feedback.distance) == (15, 0.25)
    assert (found.feedback.objects, found.feedback.policy_version) == (["hand"], 7)


def test_bursts_are_recorded_whole_from_latched_and_plain_publishers(tmp_path):
    plain = topics.Topic("program", topics.PROGRAM.type, topics.STEP, topics.STEP)
    recorded = [topics.PROGRAM, topics.TRAJECTORIES, topics.JOINT_COMMANDS]
    with client_node("test") as node, Recorder(tmp_path / "bag", node, recorded) as recorder:
        volatile = publisher_heard(node, plain)
        latched = publisher_heard(node, topics.PROGRAM)
        commands = publisher_heard(node, topics.JOINT_COMMANDS)
        for _ in range(20):
            volatile.publish(REQUEST)
            latched.publish(REQUEST)
        for _ in range(2000):
            commands.publish(topics.JOINT_COMMANDS.type())
        wait_for(lambda: recorder.counts["/joint_commands"] == 2000, "every command")
        wait_for(lambda: recorder.counts["/program"] >= 40, "every program")
    assert recorder.counts == {"/program": 40, "/trajectories": 0, "/joint_commands": 2000}
    assert sum(recorder.lost.values()) == 0


@pytest.mark.parametrize("by_s", [-3600, 3600])
def test_a_clock_that_is_set_moves_no_message_in_a_recording(tmp_path, monkeypatch, by_s):
    wall_ns = time.time_ns
    with (
        client_node("test") as node,
        Recorder(tmp_path / "bag", node, [topics.PROGRAM]) as recorder,
    ):
        publisher = publisher_heard(node, topics.PROGRAM)
        publisher.publish(REQUEST)
        wait_for(lambda: recorder.counts["/program"] == 1, "the first message")
        # The middleware keeps the clock of before, as for messages that wait when it is set.
        monkeypatch.setattr(time, "time_ns", lambda: wall_ns() + by_s * 10**9)
        publisher.publish(REQUEST)
        wait_for(lambda: recorder.counts["/program"] == 2, "the second message")
    assert information(tmp_path / "bag")["duration"]["nanoseconds"] < 10**9 * DEADLINE_S


def test_messages_that_a_publisher_dropped_are_counted_as_lost(tmp_path):
    """A best-effort publisher that keeps one message, and messages of a megabyte each."""
    careless = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    large = topics.Topic("program", topics.PROGRAM.type, careless, careless)
    message = encode_program(ProgramRequest("id", "X" * 1_000_000))
    with client_node("test") as node, Recorder(tmp_path / "bag", node, [large]) as recorder:
        publisher = publisher_heard(node, large)
        for _ in range(200):
            publisher.publish(message)
        publisher.publish(REQUEST)  # the last one comes through
        wait_for(lambda: sum([*recorder.counts.values(), *recorder.lost.values()]) >= 201, "all")
        assert recorder.counts["/program"] + recorder.lost["/program"] == 201


def test_metadata_states_qos_and_type_hashes_of_the_live_graph(tmp_path):
    bag, store = tmp_path / "bag", installed_types()
    with client_node("test", "arena1") as node, Recorder(bag, node, BAG_TOPICS):
        live = {}
        for topic in (topics.PROGRAM, topics.POLICY_WEIGHTS, topics.TRAJECTORIES):
            node.create_publisher(topic.type, topic.name, topic.writer)
            (info,) = node.get_publishers_info_by_topic(topic.name)
            live[node.resolve_topic_name(topic.name)] = str(info.topic_type_hash)
            assert str(info.topic_type_hash) == store.hash_rihs01(message_type(topic.type))
    about = information(bag)
    entries = {
        row["topic_metadata"]["name"]: row["topic_metadata"]
        for row in about["topics_with_message_count"]
    }
    assert about["storage_identifier"] == "mcap" and about["ros_distro"] == "jazzy"
    for name, digest in live.items():
        assert entries[name]["type_description_hash"] == digest
    assert entries["/arena1/program"]["offered_qos_profiles"][0]["durability"] == "transient_local"
    assert entries["/arena1/trajectories"]["offered_qos_profiles"][0]["history"] == "keep_all"
    assert entries["/arena1/clock"]["type"] == "rosgraph_msgs/msg/Clock"
    with Reader(bag) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
    assert types["/arena1/program"] == "msgs_schema/msg/Program"


def test_a_driver_with_best_effort_is_recorded(tmp_path):
    kind = topics.JOINT_STATES.type
    with client_node("test") as node, Recorder(tmp_path / "bag", node) as recorder:
        driver = node.create_publisher(kind, "joint_states", best_effort(topics.STEP))
        wait_for(lambda: driver.get_subscription_count() > 0, "the recorder's reader")
        driver.publish(kind(name=["a"]))
        wait_for(lambda: recorder.counts["/joint_states"] == 1, "the message")


def test_an_existing_folder_and_a_topic_without_a_publisher_are_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr("pa_ros.tools.record.DISCOVERY_S", 0.5)
    with client_node("test") as node:
        with pytest.raises(BagError, match="already exists"):
            Recorder(tmp_path, node)
        with pytest.raises(BagError, match="nobody publishes .*/nothing"):
            topics_named(node, ["program", "nothing"])
        other = node.create_publisher(topics.JOINT_STATES.type, "elsewhere", 10)
        chosen = topics_named(node, ["program", "elsewhere"])
        assert [topic.type for topic in chosen] == [topics.PROGRAM.type, other.msg_type]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_recording_ended_by_a_signal_is_readable(tmp_path, number):
    bag = tmp_path / "bag"
    with pa_ros("record", bag) as process:
        try:
            assert process.stdout.readline().startswith("recording into")
            with client_node("test") as node:
                publisher_heard(node, topics.PROGRAM).publish(REQUEST)
                wait_for(lambda: grown(bag), "the message on disk")
            process.send_signal(number)
            assert process.wait(DEADLINE_S) == (-9 if number == signal.SIGKILL else 0)
        finally:
            process.kill()
    if number == signal.SIGKILL:
        assert repair(bag).messages == 1
    with Reader(bag) as reader:
        store = installed_types()
        found: list[Any] = [
            store.deserialize_cdr(raw, c.msgtype) for c, _, raw in reader.messages()
        ]
    assert [message.text for message in found] == ["NEAR(HAND, RED)"]
    assert not (bag / ".reserve").exists()


def grown(bag: Path) -> bool:
    """Whether a message has been flushed."""
    (file,) = bag.glob("*.mcap")
    return b"NEAR(HAND, RED)" in file.read_bytes()


def test_memory_stays_bounded(tmp_path):
    """Recording 150 MB makes the process grow by a fraction of that."""
    with client_node("test") as node, Recorder(tmp_path / "b", node, [topics.TRAJECTORIES]) as bag:
        large = topics.TRAJECTORIES.type(program="X" * 1_000_000)
        publisher = publisher_heard(node, topics.TRAJECTORIES)
        for count in range(1, 151):
            publisher.publish(large)
            wait_for(kept_up(bag, count - 5), "keeping up")
            if count == 50:
                before = resident_mb()
        wait_for(lambda: bag.counts["/trajectories"] == 150, "all")
        assert bag.size_mb > 125
        assert resident_mb() - before < 40


def kept_up(recorder: Recorder, count: int) -> Callable[[], bool]:
    return lambda: recorder.counts["/trajectories"] >= count


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.parametrize(
    "asked", [["--topics", "bad topic!"], ["--arenas", "a b"], ["--namespace", "a b"]]
)
def test_names_that_ros_rejects_leave_no_bag(tmp_path, capsys, asked):
    assert main(["record", str(tmp_path / "bag"), *asked]) == 2
    error = capsys.readouterr().err
    assert "not the name of a topic" in error or "namespace" in error
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(
    ("numbers", "publishers", "lost", "before"),
    [
        ([1, 2, 3], 1, 0, 0),
        ([1, 2, 5], 1, 2, 0),
        ([7, 8, 9], 1, 0, 6),  # joined late
        ([1, 1, 2, 2, 3, 3], 2, 0, 0),
        ([1, 2, 1, 2, 3], 1, 0, 0),  # restarted
        ([1, 1, 2, 4, 3], 2, 2, 0),
    ],
)
def test_losses_are_counted_from_the_publishers_numbers(numbers, publishers, lost, before):
    gaps = SequenceGaps(lambda: publishers)
    for number in numbers:
        gaps.take(number)
    assert (gaps.lost, gaps.before) == (lost, before)
