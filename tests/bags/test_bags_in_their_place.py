"""A bag's folder: moved while it is written, named in a command, and given to nothing else."""

from __future__ import annotations

import errno
import os
import shlex

import pytest

from helpers.recordings import START, identifiers, payload, storage_file, train, written
from pa_ros.bags.errors import BagFullError, BagMovedError
from pa_ros.bags.repair import repair
from pa_ros.cli.main import main


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_that_is_moved_while_it_is_recorded_is_whole_after_a_repair(tmp_path, storage):
    bag = written(tmp_path / "bag", 3, close=False, split_s=3.0, storage=storage)
    (tmp_path / "bag").rename(tmp_path / "there")
    with pytest.raises(BagMovedError) as moved:
        bag.write("/program", payload(3), START + 10**10)
    said = str(moved.value)
    assert f"bag: {tmp_path / 'bag'}: the folder was moved or deleted while it was" in said
    assert "`pa_ros record --repair FOLDER`" in said and "space" not in said
    repair(tmp_path / "there")
    assert identifiers(tmp_path / "there") == [0, 1, 2]


def test_a_bag_that_is_moved_before_it_is_closed_is_refused_likewise(tmp_path):
    bag = written(tmp_path / "bag", 3, close=False)
    (tmp_path / "bag").rename(tmp_path / "there")
    with pytest.raises(BagMovedError, match="where it went, `pa_ros record --repair FOLDER`"):
        bag.close()
    repair(tmp_path / "there")
    assert identifiers(tmp_path / "there") == [0, 1, 2]


@pytest.mark.parametrize(("number", "space"), [(errno.ENOSPC, True), (errno.EACCES, False)])
def test_space_is_spoken_of_where_it_is_lacking(tmp_path, monkeypatch, number, space):
    bag = written(tmp_path / "bag", 3, close=False)

    def refuse(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("pa_ros.bags.storage.McapStorage.write", refuse)
    monkeypatch.setattr("pa_ros.bags.writer.finish", refuse)
    with pytest.raises(BagFullError) as refused:
        bag.write("/program", payload(3), START + 10**10)
    said = str(refused.value)
    assert ("where there is space" in said) == space and "record --repair" in said


def test_a_printed_command_can_be_given_to_a_shell(tmp_path, capsys):
    bags = [tmp_path / "it's a bag", tmp_path / "no yaml", tmp_path / "no index"]
    for bag in bags:
        written(bag, 1)
    (bags[0] / "metadata.yaml").unlink()
    (bags[1] / "metadata.yaml").write_text("a: [")
    storage_file(bags[2]).write_bytes(b"")
    for bag in bags:
        assert main(["bag", "info", str(bag)]) == 2
        command = capsys.readouterr().err.split("`")[1]
        assert shlex.split(command) == ["pa_ros", "record", "--repair", str(bag)]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_nothing_else_is_put_into_a_bags_folder(tmp_path, capsys, storage):
    bag = tmp_path / "bag"
    written(bag, 3, storage=storage)
    for lacking in ("nothing", "metadata.yaml"):
        (bag / lacking).unlink(missing_ok=True)
        before = {path: path.read_bytes() for path in bag.iterdir()}
        for command in (["train", "--frames", "100"], ["train", "--from-bag", str(bag)]):
            assert main([*command, "--out", str(bag)]) == 2
            said = capsys.readouterr().err
            assert f"bag: {bag}: expected a folder for other files" in said
            assert said.count("\n") == 1
            assert {path: path.read_bytes() for path in bag.iterdir()} == before


def test_episodes_are_not_exported_into_a_bag(tmp_path, capsys):
    assert train(tmp_path, "--record", tmp_path / "bag", frames=100) == 0
    before = sorted(tmp_path.rglob("*"))
    bag = str(tmp_path / "bag")
    assert main(["bag", "export", bag, "--out", bag]) == 2
    assert f"bag: {bag}: expected a folder for other files" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("option", ["--design=3-D", "--protocol=paper"])
def test_what_the_recording_says_may_be_said_again(tmp_path, option):
    assert train(tmp_path, "--record", tmp_path / "bag", option, frames=100) == 0
    out = ["--out", str(tmp_path / "out")]
    assert main(["train", "--from-bag", str(tmp_path / "bag"), *out, option]) == 0


def test_an_existing_bag_is_refused_before_training(tmp_path, capsys):
    written(tmp_path / "bag", 3)
    assert train(tmp_path / "run", "--record", tmp_path / "bag") == 2
    assert "exists already" in capsys.readouterr().err
    assert [*tmp_path.iterdir()] == [tmp_path / "bag"]


def test_what_is_refused_leaves_no_folder(tmp_path, capsys):
    assert main(["train", "--out", str(tmp_path / "run"), "--from-bag", str(tmp_path / "no")]) == 2
    assert "expected a bag, found none" in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]
