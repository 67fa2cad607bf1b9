"""Bags that were cut off or damaged, and full disks: what is whole is kept, the rest is named."""

import errno
import os
import shlex
import shutil
from unittest.mock import Mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from helpers.recordings import START, identifiers, payload, storage_file, train, written
from pa_ros.bags.errors import BagError, BagFullError
from pa_ros.bags.format import RESERVE
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.bags.storage import McapStorage
from pa_ros.cli.main import main


def failing(number: int) -> Mock:
    return Mock(side_effect=OSError(number, os.strerror(number)))


def test_a_killed_recording_is_named_and_repaired(tmp_path, capsys):
    bag = tmp_path / "it's a bag"
    killed = written(tmp_path / "live", 7, close=False)
    shutil.copytree(tmp_path / "live", bag)
    killed.close()
    assert main(["bag", "info", str(bag)]) == 2
    command = shlex.split(capsys.readouterr().err.split("`")[1])
    assert command == ["pa_ros", "record", "--repair", str(bag)]
    assert main(command[1:]) == 0
    assert not (bag / RESERVE).exists()
    assert "7 messages in 1 file(s) can be read" in capsys.readouterr().out
    assert identifiers(bag) == list(range(7))
    before = storage_file(bag).read_bytes()
    assert repair(bag).messages == 7 and storage_file(bag).read_bytes() == before


def test_a_running_recording_is_neither_read_nor_repaired(tmp_path, capsys):
    bag = tmp_path / "bag"
    with written(bag, 7, close=False):
        before = {path.name: path.read_bytes() for path in bag.iterdir()}
        with pytest.raises(BagError, match="still recording"):
            Bag(bag)
        assert main(["record", "--repair", str(bag)]) == 2
        assert "still recording" in capsys.readouterr().err
        assert {path.name: path.read_bytes() for path in bag.iterdir()} == before
    assert repair(bag).messages == 7


@pytest.mark.parametrize("name", ["bag", "run_9"])
def test_repaired_files_are_in_the_order_of_their_messages(tmp_path, name):
    written(tmp_path / name, 12, split_s=1.0)
    metadata = tmp_path / name / "metadata.yaml"
    *before, _ = metadata.read_text().partition("custom_data")
    metadata.unlink()
    assert repair(tmp_path / name).files == 12
    assert [*metadata.read_text().partition("custom_data")][:2] == before
    assert identifiers(tmp_path / name) == list(range(12))


@settings(max_examples=40, deadline=None)
@given(cut=st.integers(0, 8000))
def test_wherever_a_file_is_cut_repair_keeps_what_is_complete(tmp_path_factory, whole, cut):
    content = whole[1]
    folder = tmp_path_factory.mktemp("cut")
    (folder / "bag.mcap").write_bytes(content[:cut])
    done = repair(folder)
    found = identifiers(folder)
    assert found == list(range(len(found))) and len(found) == done.messages
    if cut >= len(content):
        assert done.messages == 12
    with (folder / "bag.mcap").open("rb") as stream:
        read = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        assert [int(one.decoded_message.program_id) for one in read] == found


def test_messages_before_a_damaged_place_are_kept(whole, tmp_path, capsys):
    folder, content = tmp_path / "bag", bytearray(whole[1])
    folder.mkdir()
    content[content.rindex(b"X" * 200) + 50] ^= 1
    (folder / "bag.mcap").write_bytes(content)
    assert repair(folder).messages == 11 and identifiers(folder) == list(range(11))
    assert (folder / "bag.mcap.original").read_bytes() == content
    assert main(["bag", "info", str(folder)]) == 0
    assert "bag.mcap: cut off after 11 messages (CRC" in capsys.readouterr().out


def test_a_repair_without_space_for_a_copy_changes_nothing(whole, tmp_path, monkeypatch):
    (tmp_path / "bag.mcap").write_bytes(whole[1][:-30])
    monkeypatch.setattr("pa_ros.bags.repair.os.fsync", failing(errno.ENOSPC))
    with pytest.raises(BagFullError, match="needs space for a copy"):
        repair(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["bag.mcap"]
    assert (tmp_path / "bag.mcap").read_bytes() == whole[1][:-30]


def test_a_full_disk_closes_the_bag_with_everything_it_received(tmp_path, monkeypatch):
    """The space set aside at the start holds the last chunk and the index."""
    bag = written(tmp_path / "bag", 3, close=False)
    write = os.write

    def full(descriptor, content):
        if (tmp_path / "bag" / RESERVE).exists():
            write(descriptor, content[: len(content) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, content)

    monkeypatch.setattr("pa_ros.bags.storage.os.write", full)
    bag.write("/program", payload(3), START + 10**10)
    with pytest.raises(BagFullError, match="No space left.*closed with everything it received"):
        bag.flush()
    with pytest.raises(BagFullError):
        bag.write("/program", payload(4), START + 10**10)
    assert identifiers(tmp_path / "bag") == [0, 1, 2, 3]


def test_a_disk_that_takes_nothing_more_leaves_a_bag_to_repair(tmp_path, monkeypatch):
    bag = written(tmp_path / "bag", 3, close=False)
    with monkeypatch.context() as patch:
        patch.setattr("pa_ros.bags.storage.os.write", failing(errno.EFBIG))
        bag.write("/program", payload(3), START + 10**10)
        with pytest.raises(BagFullError, match="`pa_ros record --repair"):
            bag.flush()
    repair(tmp_path / "bag")
    assert identifiers(tmp_path / "bag") == [0, 1, 2]


def test_a_flush_that_fails_gives_the_bag_up_and_closes_its_file(tmp_path, monkeypatch):
    bag = written(tmp_path / "bag", 3, close=False)
    with monkeypatch.context() as patch:
        patch.setattr(McapStorage, "flush", failing(errno.EIO))
        bag.write("/program", payload(3), START + 10**10)
        with pytest.raises(BagFullError, match="`pa_ros record --repair"):
            bag.flush()
    held = {os.path.realpath(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")}
    assert not [path for path in held if path.startswith(str(bag.folder))]
    assert repair(bag.folder).messages == 3


def test_half_a_recorded_run_is_described_after_repair(tmp_path, capsys, monkeypatch):
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
