"""Bags as files: written as stock tools expect, split, repaired, and refused in one clear line."""

from __future__ import annotations

import copy
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from helpers.recordings import START, TOPIC, identifiers, payload, storage_file, train, written
from pa_ros.bags.contents import reliable_qos, topic
from pa_ros.bags.errors import (
    BagError,
    BagFullError,
    ForeignBagError,
)
from pa_ros.bags.losses import LOST, Losses
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.bags.summary import describe
from pa_ros.bags.writer import BagOptions, BagWriter
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_is_written_is_read_by_us_and_by_rosbags(tmp_path, storage):
    written(tmp_path / "bag", 5, storage=storage)
    assert identifiers(tmp_path / "bag") == list(range(5))
    with Bag(tmp_path / "bag") as bag:
        assert (bag.counts, bag.first_ns, bag.duration_s) == ({"/program": 5}, START, 4.0)
        assert bag.custom["pa_ros.test"] == "yes"
        assert bag.qos("/program")[0].durability.name == "TRANSIENT_LOCAL"
        middle = bag.messages(None, START + 10**9, START + 3 * 10**9)
        assert [m.stamp_ns for m in middle] == [START + 10**9, START + 2 * 10**9]
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 5
        assert [c.digest for c in reader.connections] == [TOPIC.digest] or storage == "mcap"


def test_a_type_is_defined_once_however_many_topics_have_it(tmp_path):
    with BagWriter(tmp_path / "bag", BagOptions(storage="sqlite3")) as bag:
        bag.add(TOPIC)
        bag.add(replace(TOPIC, name="/left/program"))
    with closing(sqlite3.connect(storage_file(tmp_path / "bag"))) as database:
        rows = database.execute("SELECT topic_type FROM message_definitions").fetchall()
        assert rows == [(TOPIC.type_name,)]


def test_of_several_topics_one_is_chosen_by_its_namespace(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for name in ("/left/program", "/right/program"):
            bag.add(replace(TOPIC, name=name))
    with Bag(tmp_path / "bag") as bag:
        assert bag.topic_of(TOPIC.type_name, "left") == "/left/program"
        with pytest.raises(ForeignBagError, match="msgs_schema/msg/Program, got /left/.*choose"):
            bag.topic_of(TOPIC.type_name)
        with pytest.raises(ForeignBagError, match="msgs_schema/msg/Program below /middle/, got"):
            bag.topic_of(TOPIC.type_name, "middle")


def test_an_independent_reader_sees_sequence_numbers_times_and_definitions(tmp_path):
    written(tmp_path / "bag", 3)
    with storage_file(tmp_path / "bag").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        found = [(s, c, m, d) for s, c, m, d in reader.iter_decoded_messages()]
    assert summary.statistics.message_count == 3
    assert [(m.sequence, m.log_time, m.publish_time) for _, _, m, _ in found] == [
        (i + 1, START + i * 10**9, START + i * 10**9 - 5) for i in range(3)
    ]
    assert {s.name for s, *_ in found} == {"msgs_schema/msg/Program"}
    assert found[0][1].metadata["topic_type_hash"] == TOPIC.digest
    assert found[2][3].text == "X" * 10


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("limits", [{"split_s": 3.0}, {"split_mb": 0.1}])
def test_a_bag_is_split_by_time_and_size(tmp_path, storage, limits):
    written(tmp_path / "bag", 10, 40_000, storage=storage, **limits)
    about = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    files = about["rosbag2_bagfile_information"]["files"]
    assert len(files) in (4, 5) and sum(file["message_count"] for file in files) == 10
    assert [file["path"].count("_") for file in files] == [0] + [1] * (len(files) - 1)
    assert identifiers(tmp_path / "bag") == list(range(10))
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert repair(tmp_path / "bag").messages == 10
    assert identifiers(tmp_path / "bag") == list(range(10))


@pytest.mark.parametrize("name", ["run_9", "run", "run_0"])
def test_files_are_in_order_whatever_the_bags_name_ends_in(tmp_path, name):
    folder = tmp_path / name
    written(folder, 30, split_s=2.0)
    (folder / "metadata.yaml").unlink()
    assert repair(folder).files == 15
    assert identifiers(folder) == list(range(30))
    for file in folder.glob("*.mcap"):  # as stock recorders call them
        number = file.stem.removeprefix(f"{name}_") if file.stem != name else "0"
        file.rename(folder / f"{name}_{number}.part")
    for file in folder.glob("*.part"):
        file.rename(file.with_suffix(".mcap"))
    repair(folder)
    assert identifiers(folder) == list(range(30))


@settings(max_examples=40, deadline=None)
@given(at=st.integers(0, 5000), value=st.integers(0, 255))
def test_a_flipped_byte_is_read_or_refused_but_never_a_traceback(
    tmp_path_factory, whole, at, value
):
    content = bytearray(whole[1])
    content[at % len(content)] = value
    folder = tmp_path_factory.mktemp("flipped")
    (folder / "bag.mcap").write_bytes(content)
    shutil.copy(whole[0] / "metadata.yaml", folder)
    try:
        identifiers(folder)
    except (BagError, ValueError) as error:  # ValueError: a program_id that is no number now
        assert str(error)
    assert main(["bag", "info", str(folder)]) in (0, 1, 2)


COMMANDS = (
    ["bag", "info"], ["verify"], ["play", "--wait", "0"],
    ["bag", "export", "--out", "OUT"], ["train", "--out", "OUT", "--from-bag"],
)  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: "-".join(command[:2]))
@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda path: None, "expected a bag, found none"),
        (lambda path: path.mkdir(), "expected .mcap or .db3 files"),
        (lambda path: path.write_text("not a bag"), ""),
        (lambda path: _with(path, "bag.mcap", b""), "record --repair"),
        (lambda path: _with(path, "bag.mcap", b"", b"version: x"), ""),
        (lambda path: _unknown_storage(path), ""),
    ],
    ids=["absent", "empty", "text", "half-written", "bad-metadata", "unknown-storage"],
)
def test_whatever_is_not_a_bag_is_refused_in_one_line(tmp_path, capsys, command, make, expected):
    bag = tmp_path / "bag"
    make(bag)
    arguments = [str(tmp_path / "out") if part == "OUT" else part for part in command]
    assert main([*arguments[:1], *arguments[1:], str(bag)]) == 2
    error = capsys.readouterr().err
    assert expected in error and str(bag) in error and "Traceback" not in error
    assert len(error.strip().splitlines()) <= 3


def _with(path: Path, name: str, content: bytes, metadata: bytes | None = None) -> None:
    path.mkdir()
    (path / name).write_bytes(content)
    if metadata is not None:
        (path / "metadata.yaml").write_bytes(metadata)


def _unknown_storage(path: Path) -> None:
    written(path, 1)
    metadata = path / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("storage_identifier: mcap", "storage_identifier: zarr")
    )


def test_a_file_outside_the_bag_is_not_read(whole, tmp_path, capsys):
    shutil.copytree(whole[0], tmp_path / "bag")
    (tmp_path / "bag" / "bag.mcap").rename(tmp_path / "other.mcap")
    about = tmp_path / "bag" / "metadata.yaml"
    about.write_text(about.read_text().replace("bag.mcap", "../other.mcap"))
    assert main(["bag", "info", str(tmp_path / "bag")]) == 2
    assert "expected files of this folder, got '../other.mcap'" in capsys.readouterr().err


NOTHING = (None, [], "x", float("inf"))


def leaves(node: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of a metadata.yaml; of lists the first item."""
    yield at
    if isinstance(node, dict):
        for key, value in node.items():
            yield from leaves(value, (*at, key))
    elif isinstance(node, list) and node:
        yield from leaves(node[0], (*at, 0))


def test_whatever_stands_in_metadata_is_read_or_refused(whole, tmp_path):
    shutil.copytree(whole[0], tmp_path / "bag")
    about = tmp_path / "bag" / "metadata.yaml"
    content = yaml.safe_load(about.read_text())
    content["rosbag2_bagfile_information"]["custom_data"] = {LOST: "{}"}
    refused = 0
    for *above, last in filter(None, leaves(content)):
        for value in NOTHING:
            damaged = copy.deepcopy(content)
            place = damaged
            for key in above:
                place = place[key]
            place[last] = value
            about.write_text(yaml.safe_dump(damaged))
            try:
                with Bag(tmp_path / "bag") as bag:
                    refused += "not readable" in "".join(describe(bag))
            except BagError:
                refused += 1
    assert refused > 50


def test_a_foreign_bag_says_what_it_has_instead(tmp_path, capsys):
    store = get_typestore(Stores.ROS2_JAZZY)
    with BagWriter(tmp_path / "bag") as bag:
        bag.add(topic(store, "/chatter", "std_msgs/msg/String", [reliable_qos(1)]))
        message = store.types["std_msgs/msg/String"]("hello")
        bag.write("/chatter", bytes(store.serialize_cdr(message, "std_msgs/msg/String")), START)
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0
    out = capsys.readouterr().out
    assert "/chatter  std_msgs/msg/String  1" in out and "nothing of ours to tell" in out
    for command in (["verify"], ["train", "--out", str(tmp_path / "out"), "--from-bag"]):
        assert main([*command, str(tmp_path / "bag")]) == 2
        assert "expected a topic of type msgs_schema/msg/Trajectory" in capsys.readouterr().err


@pytest.mark.graph
def test_an_older_definition_is_named_and_not_misread(tmp_path, capsys):
    """Transitions of an edition without `terminated`, which learning needs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    name, text = "msgs_schema/msg/Trajectory", "string agent_id\nuint64 sequence\n"
    store.register(get_types_from_msg(text, name))
    with BagWriter(tmp_path / "bag") as bag:
        bag.add(topic(store, "/trajectories", name, [reliable_qos(1)]))
        message = store.types[name]("agent", 0)
        bag.write("/trajectories", bytes(store.serialize_cdr(message, name)), START)
    assert main(["bag", "info", str(tmp_path / "bag")]) == 1
    assert "another edition of the definition than is installed here" in capsys.readouterr().out
    out = ["--out", str(tmp_path / "out")]
    assert main(["train", *out, "--from-bag", str(tmp_path / "bag")]) == 2
    assert "another edition of msgs_schema/msg/Trajectory" in capsys.readouterr().err
    assert main(["play", "--wait", "0", str(tmp_path / "bag")]) == 2
    assert "recorded with another edition" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ["bag", "info"],
        ["bag", "export", "--out", "out"],
        ["verify"],
        ["train", "--out", "out", "--from-bag"],
    ],
)
def test_a_recording_of_version_0_1_is_refused(command, tmp_path, capsys, monkeypatch):
    """A run of 100 frames that version 0.1 recorded, but for its weights."""
    monkeypatch.chdir(tmp_path)
    assert main([*command, str(Path(__file__).with_name("version-0.1"))]) == 2
    error = capsys.readouterr().err
    assert "expected messages of edition 3, got edition 1, which version 0.1 records" in error
    assert error.count("\n") == 1
    assert {path.name for path in tmp_path.rglob("*")} <= {"out", ".lock"}


def test_half_a_recorded_run_is_told_of_after_repair(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pa_ros.bags.run_log.FLUSH_S", 0.0)
    assert train(tmp_path, "--record", tmp_path / "bag", frames=300) == 0
    bag = storage_file(tmp_path / "bag")
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size * 2 // 3])
    assert main(["verify", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert "record --repair" in error and "Traceback" not in error
    assert main(["record", "--repair", str(tmp_path / "bag")]) == 0
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0
    out = capsys.readouterr().out
    assert "repaired after its recorder was killed" in out and "of transitions, no gaps" in out


def test_a_full_disk_leaves_a_readable_bag(tmp_path, monkeypatch):
    bag = written(tmp_path / "bag", 3, close=False)

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pa_ros.bags.storage.McapStorage.write", refuse)
    with pytest.raises(BagFullError, match="3 messages are in the bag, which was closed"):
        bag.write("/program", payload(3), START + 10**10)
    with pytest.raises(BagFullError):
        bag.write("/program", payload(3), START + 10**10)
    assert identifiers(tmp_path / "bag") == [0, 1, 2]


def test_options_and_folders_that_cannot_be_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="zarr"):
        BagOptions(storage="zarr")
    with pytest.raises(ConfigError, match="split_s.*-1"):
        BagOptions(split_s=-1)
    with pytest.raises(ConfigError, match="split_s.*inf"):
        BagOptions(split_s=float("inf"))
    assert BagOptions(split_s=0, split_mb=0).split_s == 0  # never
    with pytest.raises(BagError, match="exists already"):
        BagWriter(tmp_path)
    with BagWriter(tmp_path / "twice") as twice:
        twice.add(TOPIC)
        with pytest.raises(BagError, match="declared twice"):
            twice.add(TOPIC)
    bag = written(tmp_path / "bag", 1)
    with pytest.raises(BagError, match="closed already"):
        bag.write("/program", b"", START)
    assert sqlite3.sqlite_version  # the other storage is there


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
    losses = Losses(lambda: publishers)
    for number in numbers:
        losses.take(number)
    assert (losses.lost, losses.before) == (lost, before)


def test_info_compares_with_what_was_published(tmp_path, capsys):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add(TOPIC)
        for number in (3, 4, 6):
            bag.write("/program", payload(number), START + number, START, number)
    assert main(["bag", "info", str(tmp_path / "bag")]) == 0
    assert (
        "msgs_schema/msg/Program  3 of 4 published, 2 before the first heard"
        in capsys.readouterr().out
    )


def compressed(folder: Path, mode: CompressionMode) -> Path:
    """A bag of three programs as stock tools compress it, by file or by message."""
    bag = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag:
        name, text = TOPIC.type_name, TOPIC.definition
        program = bag.add_connection("/program", name, msgdef=text, rihs01=TOPIC.digest)
        for i in range(3):
            bag.write(program, START + i, payload(i))
    return folder


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_a_compressed_bag_is_read_and_told_of(tmp_path, capsys, mode):
    bag = compressed(tmp_path / "bag", mode)
    assert main(["bag", "info", str(bag)]) == 0
    assert "/program  msgs_schema/msg/Program  3" in capsys.readouterr().out
    if mode == CompressionMode.MESSAGE:
        assert repair(bag).messages == 3
    assert identifiers(bag) == [0, 1, 2]


def test_what_to_do_with_compressed_files_without_an_index_is_said(tmp_path, capsys):
    bag = compressed(tmp_path / "bag", CompressionMode.FILE)
    (bag / "metadata.yaml").unlink()
    for command in (["bag", "info"], ["record", "--repair"]):
        assert main([*command, str(bag)]) == 2
        assert "expected plain .mcap or .db3 files, got bag.mcap.zstd" in capsys.readouterr().err


def test_a_file_that_a_repair_left_out_hides_no_numbers(tmp_path, capsys):
    written(tmp_path / "bag", 4, split_s=2.0)
    (tmp_path / "bag" / "bag_1.mcap").write_bytes(b"")
    assert repair(tmp_path / "bag").messages == 2
    assert main(["bag", "info", str(tmp_path / "bag")]) == 1
    out = capsys.readouterr().out
    assert "NOT SEEN: bag_1.mcap: left out" in out and "2 of 2 published" in out
    assert "not readable: bag:" not in out
