"""Bags that were cut off or damaged: repair keeps what is whole, and says what is not."""

from __future__ import annotations

import shutil

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from helpers.recordings import identifiers, storage_file, written
from pa_ros.bags.contents import RESERVE
from pa_ros.bags.errors import BagInUseError, DamagedBagError, UnfinishedBagError
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import _FINISH, repair
from pa_ros.cli.main import main


def test_repair_puts_part_10_after_part_2(tmp_path):
    written(tmp_path / "bag", 12, split_s=1.0)
    metadata = tmp_path / "bag" / "metadata.yaml"
    before = yaml.safe_load(metadata.read_text())["rosbag2_bagfile_information"]
    metadata.unlink()
    assert repair(tmp_path / "bag").files == 12
    after = yaml.safe_load(metadata.read_text())["rosbag2_bagfile_information"]
    assert after["relative_file_paths"] == before["relative_file_paths"]
    assert after["relative_file_paths"][10] == "bag_10.mcap"
    assert identifiers(tmp_path / "bag") == list(range(12))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_killed_recording_is_named_and_repaired(tmp_path, storage, capsys):
    bag = tmp_path / "bag"
    killed = written(tmp_path / "live", 7, close=False, storage=storage)
    shutil.copytree(tmp_path / "live", bag)
    killed.close()
    with pytest.raises(UnfinishedBagError, match="record --repair"):
        Bag(bag)
    assert main(["record", "--repair", str(bag)]) == 0
    assert not (bag / RESERVE).exists()
    assert "7 messages in 1 file(s) can be read" in capsys.readouterr().out
    assert identifiers(bag) == list(range(7))
    before = storage_file(bag).read_bytes()
    assert repair(bag).messages == 7 and storage_file(bag).read_bytes() == before


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_recording_that_goes_on_is_not_taken_for_a_killed_one(tmp_path, storage, capsys):
    bag = tmp_path / "bag"
    with written(bag, 7, close=False, storage=storage):
        before = {path.name: path.read_bytes() for path in bag.iterdir()}
        with pytest.raises(BagInUseError, match="still being recorded"):
            Bag(bag)
        assert main(["record", "--repair", str(bag)]) == 2
        assert "still being recorded" in capsys.readouterr().err
        assert {path.name: path.read_bytes() for path in bag.iterdir()} == before
    assert identifiers(bag) == list(range(7))
    assert repair(bag).messages == 7


def test_a_bag_is_repaired_by_one_at_a_time(whole, tmp_path, monkeypatch):
    (tmp_path / "bag.mcap").write_bytes(whole[1][:-30])
    refused = []

    def another(path):
        with pytest.raises(BagInUseError) as found:
            repair(tmp_path)
        refused.append(found.value)
        return []

    monkeypatch.setitem(_FINISH, ".mcap", another)
    with pytest.raises(DamagedBagError):
        repair(tmp_path)
    assert len(refused) == 1


@settings(max_examples=40, deadline=None)
@given(cut=st.integers(0, 8000))
def test_wherever_a_file_is_cut_repair_keeps_what_is_complete(tmp_path_factory, whole, cut):
    content = whole[1]
    folder = tmp_path_factory.mktemp("cut")
    (folder / "bag.mcap").write_bytes(content[:cut])
    try:
        done = repair(folder)
    except DamagedBagError:
        assert cut < 35  # not even the format's own first record
        return
    found = identifiers(folder)
    assert found == list(range(len(found))) and len(found) == done.messages
    if cut >= len(content):
        assert done.messages == 12
    with (folder / "bag.mcap").open("rb") as stream:
        read = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        assert [int(message.program_id) for *_, message in read] == found


def test_a_damaged_chunk_is_passed_over_and_said(whole, tmp_path, capsys):
    folder, content = tmp_path / "bag", bytearray(whole[1])
    folder.mkdir()
    content[content.index(b"X" * 200, content.index(b"X" * 200) + 300) + 50] ^= 1
    (folder / "bag.mcap").write_bytes(content)
    done = repair(folder)
    assert done.notes == ("bag.mcap: 1 damaged chunks were passed over",)
    assert len(identifiers(folder)) == 11
    assert main(["bag", "info", str(folder)]) == 1
    assert "NOT SEEN: bag.mcap: 1 damaged chunks" in capsys.readouterr().out


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize("where", ["message", "definition"])
def test_a_hit_first_chunk_costs_its_own_messages_alone(whole, tmp_path, killed, where):
    """Though it is where the file says what its topics are."""
    folder, content = tmp_path / "bag", bytearray(whole[1])
    folder.mkdir()
    text = b"X" * 200 if where == "message" else b"string text"
    content[content.index(text) + 3] ^= 1
    if killed:
        del content[-30:]
    (folder / "bag.mcap").write_bytes(content)
    done = repair(folder)
    assert "bag.mcap: 1 damaged chunks were passed over" in done.notes
    assert identifiers(folder) == list(range(1, 12))
    assert (folder / "bag.mcap.original").read_bytes() == content
    again = (folder / "bag.mcap").read_bytes()
    repair(folder)
    assert (folder / "bag.mcap").read_bytes() == again
    assert (folder / "bag.mcap.original").read_bytes() == content


def test_a_repair_without_room_for_a_copy_changes_nothing(whole, tmp_path, monkeypatch):
    (tmp_path / "bag.mcap").write_bytes(whole[1][:-30])

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pa_ros.bags.tail.os.fsync", full)
    with pytest.raises(DamagedBagError, match="needs room for a copy"):
        repair(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["bag.mcap"]
    assert (tmp_path / "bag.mcap").read_bytes() == whole[1][:-30]
