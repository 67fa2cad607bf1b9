"""A bag of raw subscriptions says what was published, to readers that know nothing of us."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from pa_ros.core.experience import Observation
from pa_ros.ros import topics
from pa_ros.ros.client import client_node
from pa_ros.ros.executor import spin_until
from pa_ros.ros.record import BagError, Recorder, message_type, register
from pa_ros.wire import codec
from pa_ros.wire.records import Health, ProgramRequest

DOMAIN = "71"
DEADLINE_S = 20.0


@pytest.fixture
def own_domain(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", DOMAIN)


def observation() -> Observation:
    rng = np.random.default_rng(0)
    objects = rng.normal(size=(5, 16)).astype(np.float32)
    joints = rng.normal(size=(2, 6))
    return Observation(7, 3, 1_234_567_891, objects, joints[0], joints[1], 0, "p")


def decoded(bag: Path) -> list:
    """(topic, message) in the order recorded, by mcap-ros2-support alone."""
    with (bag / f"{bag.name}.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [(row.channel.topic, row.decoded_message) for row in reader.iter_decoded_messages()]


def publish(node, topic, messages):
    publisher = node.create_publisher(topic.type, topic.name, topic.writer)
    for message in messages:
        publisher.publish(message)


def test_what_is_decoded_equals_what_was_published(own_domain, tmp_path):
    features, joints = codec.encode_observation(observation(), tuple("abcdef"))
    health = codec.encode_diagnostics([Health("/x", 1, "hi", {"a": "b"})], 5)
    request = codec.encode_program(ProgramRequest("id", "NEAR(HAND, RED)"))
    with client_node("test") as node:
        with Recorder(tmp_path / "bag", node) as recorder:
            publish(node, topics.OBJECT_FEATURES, [features])
            publish(node, topics.JOINT_STATES, [joints])
            publish(node, topics.DIAGNOSTICS, [health])
            publish(node, topics.PROGRAM, [request] * 3)
            assert spin_until(node, lambda: sum(recorder.counts.values()) >= 4, DEADLINE_S)
    found = dict(decoded(tmp_path / "bag"))
    assert list(found["/object_features"].features) == list(features.features)
    assert found["/object_features"].header.stamp.nanosec == 234_567_891
    assert found["/joint_states"].name == list("abcdef")
    assert list(found["/joint_states"].velocity) == list(joints.velocity)
    assert found["/program"].text == "NEAR(HAND, RED)"
    assert found["/diagnostics"].status[0].values[0].value == "b"


def test_metadata_states_the_offered_qos_and_rosbags_reads_the_bag(own_domain, tmp_path):
    recorded = (topics.PROGRAM, topics.TRANSITIONS)
    with client_node("test", "arena1") as node, Recorder(tmp_path / "bag", node, recorded):
        pass
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    information = content["rosbag2_bagfile_information"]
    entries = [row["topic_metadata"] for row in information["topics_with_message_count"]]
    by_name = {entry["name"]: entry["offered_qos_profiles"][0] for entry in entries}
    assert information["storage_identifier"] == "mcap"
    assert by_name["/arena1/program"]["durability"] == "transient_local"
    assert by_name["/arena1/transitions"]["history"] == "keep_all"
    with Reader(tmp_path / "bag") as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
    assert types["/arena1/program"] == "msgs_schema/msg/Program"


def test_type_hashes_equal_those_of_the_live_graph(own_domain):
    with client_node("test") as node:
        typestore = get_typestore(Stores.ROS2_JAZZY)
        for topic in (topics.PROGRAM, topics.POLICY_WEIGHTS, topics.VERDICT):
            node.create_publisher(topic.type, topic.name, topic.writer)
            register(typestore, message_type(topic.type))
            (live,) = node.get_publishers_info_by_topic(topic.name)
            assert str(live.topic_type_hash) == typestore.hash_rihs01(message_type(topic.type))


def test_an_existing_folder_and_an_unknown_type_are_refused(own_domain, tmp_path):
    with client_node("test") as node:
        with pytest.raises(BagError, match="exists already"):
            Recorder(tmp_path, node)
    with pytest.raises(BagError, match="absent_msgs"):
        register(get_typestore(Stores.ROS2_JAZZY), "absent_msgs/msg/Nothing")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_recording_that_is_interrupted_is_readable(own_domain, tmp_path, number):
    bag = tmp_path / "bag"
    command = [sys.executable, "-m", "pa_ros.ros.record", str(bag)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline().startswith("recording into")
            with client_node("test") as node:
                request = codec.encode_program(ProgramRequest("id", "NEAR(HAND, RED)"))
                publish(node, topics.PROGRAM, [request])
                time.sleep(0.2)
                deadline = time.monotonic() + DEADLINE_S
                while not node.get_subscriptions_info_by_topic("program"):
                    assert time.monotonic() < deadline
                    spin_until(node, lambda: False, 0.1)
                spin_until(node, lambda: False, 0.5)
            process.send_signal(number)
            assert process.wait(DEADLINE_S) == 0
        finally:
            process.kill()
    assert [message.text for _, message in decoded(bag)] == ["NEAR(HAND, RED)"]


def test_memory_stays_bounded(own_domain, tmp_path):
    """60 MB through a recorder grow the process by a fraction of that."""
    with client_node("test") as node, Recorder(tmp_path / "bag", node, [topics.PROGRAM]) as bag:
        (connection,) = bag._writer.connections
        before = resident_mb()
        for _ in range(600):
            bag._keep(connection)(b"\0" * 100_000)
        assert (tmp_path / "bag" / "bag.mcap").stat().st_size > 50e6
        assert resident_mb() - before < 15


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
