"""Bags as files: written as stock tools expect, split, and rejected in one clear line."""

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from helpers.recordings import START, TOPIC, identifiers, payload, storage_file, written
from pa_ros.bags.errors import BagError
from pa_ros.bags.format import BEFORE, LOST, BagTopic, reliable_qos, topic
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main


def test_our_reader_and_rosbags_read_what_was_written(tmp_path):
    written(tmp_path / "bag", 5)
    assert identifiers(tmp_path / "bag") == list(range(5))
    with Bag(tmp_path / "bag") as bag:
        assert (bag.counts, bag.first_ns, bag.duration_s) == ({"/program": 5}, START, 4.0)
        assert bag.custom["pa_ros.test"] == "yes"
        assert bag.qos("/program")[0].durability.name == "TRANSIENT_LOCAL"
        middle = bag.messages(None, START + 10**9, START + 3 * 10**9)
        assert [m.stamp_ns for m in middle] == [START + 10**9, START + 2 * 10**9]
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 5


def test_messages_of_a_type_that_is_not_installed_are_read_by_the_bags_own_definition(tmp_path):
    name = "far_msgs/msg/Count"
    for field in ("one", "other"):  # two definitions of one type
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(f"int32 {field}", name))
        with BagWriter(tmp_path / field) as target:
            target.add(topic(store, "/count", name))
            message = store.types[name](7)
            target.write("/count", bytes(store.serialize_cdr(message, name)), START)
    for field in ("one", "other"):
        with Bag(tmp_path / field) as bag:
            assert [getattr(bag.deserialize(one), field) for one in bag.messages()] == [7]


def test_a_namespace_selects_one_of_several_topics(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for name in ("/left/program", "/right/program"):
            bag.add(replace(TOPIC, name=name))
    with Bag(tmp_path / "bag") as bag:
        assert bag.topic_of(TOPIC.type_name, "left") == "/left/program"
        with pytest.raises(BagError, match="msgs_schema/msg/Program, got /left/.*choose"):
            bag.topic_of(TOPIC.type_name)
        with pytest.raises(BagError, match="msgs_schema/msg/Program below /middle/, got /left/"):
            bag.topic_of(TOPIC.type_name, "middle")


def test_an_independent_reader_sees_sequence_numbers_times_and_definitions(tmp_path):
    written(tmp_path / "new" / "bag", 3)
    with storage_file(tmp_path / "new" / "bag").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        found = list(reader.iter_decoded_messages())
    assert summary.statistics.message_count == 3
    assert [(one.message.sequence, one.message.log_time, one.message.publish_time)
            for one in found] == [
        (i + 1, START + i * 10**9, START + i * 10**9 - 5) for i in range(3)
    ]  # fmt: skip
    assert {one.schema.name for one in found} == {"msgs_schema/msg/Program"}
    assert found[0].channel.metadata["topic_type_hash"] == TOPIC.digest
    assert found[2].decoded_message.text == "X" * 10


@pytest.mark.parametrize("limits", [{"split_s": 3.0}, {"split_mb": 0.1}])
def test_a_bag_is_split_by_time_and_size(tmp_path, limits):
    bag = written(tmp_path / "bag", 10, 40_000, **limits)
    assert bag.size == sum(p.stat().st_size for p in bag.folder.glob("bag*"))
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    about = yaml.safe_load(text)["rosbag2_bagfile_information"]
    files, times = about["files"], [about, *about["files"]]
    starts = [one["starting_time"]["nanoseconds_since_epoch"] for one in times]
    assert starts[:2] == [START, START] and starts[1:] == sorted(set(starts[1:]))
    length, *lengths = (one["duration"]["nanoseconds"] for one in times)
    assert (length, sum(lengths)) == (9 * 10**9, (10 - len(files)) * 10**9)
    assert about["message_count"] == 10
    assert [one["message_count"] for one in about["topics_with_message_count"]] == [10]
    assert len(files) in (4, 5) and sum(file["message_count"] for file in files) == 10
    assert [file["path"].count("_") for file in files] == [0] + [1] * (len(files) - 1)
    assert identifiers(tmp_path / "bag") == list(range(10))


@settings(max_examples=25, deadline=None)
@given(at=st.integers(0, 5000), value=st.integers(0, 255))
def test_a_flipped_byte_is_read_or_rejected_without_a_traceback(tmp_path_factory, whole, at, value):
    content = bytearray(whole[1])
    content[at % len(content)] = value
    folder = tmp_path_factory.mktemp("flipped")
    (folder / "bag.mcap").write_bytes(content)
    shutil.copy(whole[0] / "metadata.yaml", folder)
    assert main(["bag", "info", str(folder)]) in (0, 1, 2)


def folder_with(path: Path, **files: str) -> None:
    path.mkdir()
    for name, content in files.items():
        (path / name.replace("__", ".")).write_text(content)


NOT_BAGS: dict[str, tuple[Callable[[Path], object], str]] = {
    "absent": (lambda path: None, "expected a bag, found none"),
    "empty": (lambda path: path.mkdir(), "expected .mcap or .db3 files"),
    "a text": (lambda path: path.write_text("not a bag"), ""),
    "killed at once": (lambda path: folder_with(path, bag__mcap=""), "record --repair"),
    "metadata of something else": (
        lambda path: folder_with(path, bag__mcap="", metadata__yaml="version: x"), "",
    ),
    "metadata that is not YAML": (
        lambda path: folder_with(path, bag__mcap="", metadata__yaml="a: ["), "record --repair",
    ),
    "a pipe": (os.mkfifo, "expected a regular file"),
    "counts that are not JSON": (
        lambda path: written(path, 1, close=False).close({LOST: "["}), "expected a JSON object",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("make", "expected"), NOT_BAGS.values(), ids=NOT_BAGS)
def test_what_is_not_a_bag_is_rejected_in_one_line(tmp_path, capsys, make, expected):
    make(tmp_path / "bag")
    assert main(["bag", "info", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert expected in error and str(tmp_path / "bag") in error and "Traceback" not in error


def test_metadata_that_counts_other_messages_than_the_files_is_rejected_until_repaired(tmp_path):
    written(tmp_path / "bag", 4, split_s=2.0)
    written(tmp_path / "other", 1)
    storage_file(tmp_path / "other").rename(next((tmp_path / "bag").glob("*_1.mcap")))
    with pytest.raises(BagError, match="counts 4 messages, its files hold 3.*--repair"):
        Bag(tmp_path / "bag")
    assert repair(tmp_path / "bag").messages == 3


def test_another_quality_of_service_in_the_metadata_hides_no_message(tmp_path):
    written(tmp_path / "bag", 3)
    about = tmp_path / "bag" / "metadata.yaml"
    about.write_text(about.read_text().replace("depth: 1", "depth: 7"))
    assert identifiers(tmp_path / "bag") == [0, 1, 2]


def other_topic(type_name: str, text: str) -> BagTopic:
    """A topic of a type that is not ours, or with another definition."""
    store = get_typestore(Stores.ROS2_JAZZY)
    if type_name not in store.fielddefs:
        store.register(get_types_from_msg(text, type_name))
    return topic(store, "/topic", type_name, [reliable_qos(1)])


def test_a_foreign_bag_is_described_and_not_learned_from(tmp_path, capsys):
    chatter = other_topic("std_msgs/msg/String", "string data")
    with BagWriter(tmp_path / "bag") as bag:
        bag.add(chatter)
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0
    out = capsys.readouterr().out
    assert "/topic  std_msgs/msg/String  0" in out and "no episodes or transitions" in out
    for command in (["verify"], ["train", "--out", str(tmp_path / "out"), "--from-bag"]):
        assert main([*command, str(tmp_path / "bag")]) == 2
        assert "expected one topic of type msgs_schema/msg/Trajectory" in capsys.readouterr().err


COMMANDS = (
    ["bag", "info"], ["verify"], ["play", "--wait", "0"],
    ["bag", "export", "--out", "OUT"], ["train", "--out", "OUT", "--from-bag"],
)  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: "-".join(command[:2]))
def test_a_bag_of_another_version_is_rejected_naming_both(tmp_path, capsys, command):
    old = other_topic("msgs_schema/msg/Trajectory", "string agent_id\nuint64 sequence\n")
    with BagWriter(tmp_path / "bag") as bag:
        bag.add(old)
        bag.custom["pa_ros.version"] = "0.1.0"
    out = str(tmp_path / "out")
    assert main([*(out if one == "OUT" else one for one in command), str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert "recorded by pa_ros 0.1.0" in error and "of pa_ros 0.2.0 here" in error
    assert error.count("\n") == 1 and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("kind", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, None),
    ],
)
def test_other_bags_of_stock_tools_are_read_and_not_repaired(tmp_path, capsys, kind, mode):
    bag = Writer(tmp_path / "bag", version=9, storage_plugin=kind)
    if mode is not None:
        bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        name, text = TOPIC.type_name, TOPIC.definition
        program = bag.add_connection("/program", name, msgdef=text, rihs01=TOPIC.digest)
        for i in range(3):
            bag.write(program, START + i, payload(i))
    assert identifiers(tmp_path / "bag") == [0, 1, 2]
    assert main(["record", "--repair", str(tmp_path / "bag")]) == 2
    assert capsys.readouterr().err.startswith("pa_ros record: bag: ")
    assert identifiers(tmp_path / "bag") == [0, 1, 2]


def test_info_tells_what_was_lost_and_what_was_published_before(tmp_path, capsys):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add(TOPIC)
        bag.custom = {LOST: '{"/program": 3}', BEFORE: '{"/program": 2}'}
    with Bag(tmp_path / "bag") as empty:
        assert (empty.first_ns, empty.duration_s) == (0, 0.0)
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0
    said = "/program  msgs_schema/msg/Program  0, 3 lost while recording, 2 published before"
    assert said in capsys.readouterr().out
