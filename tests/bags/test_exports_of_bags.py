"""Exports of bags: arrays, Parquet and files for Rerun of what was recorded, or a refusal."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from helpers.recordings import DESIGN, STEPS, acted, columns, rearranged, train
from pa_ros.bags.contents import reliable_qos, topic
from pa_ros.bags.episodes import episodes
from pa_ros.bags.experience import arenas_of
from pa_ros.bags.film import Stage
from pa_ros.bags.reader import Bag
from pa_ros.bags.writer import BagWriter
from pa_ros.cli.main import main
from pa_ros.tools.scenes import name_of
from pa_ros.wire.definitions import installed_types

pytestmark = pytest.mark.xdist_group("looking into bags")  # their recordings are made once


def test_exported_arrays_are_what_was_recorded(stepped, tmp_path, capsys):
    assert main(["bag", "export", str(stepped), "--out", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "episodes.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["file"] for row in table] == ["episode-000007.npz", "eval-000007.npz"]
    steps = acted()
    rewards = [verdict.reward for _, verdict, *_ in steps[1 : STEPS + 1]]
    assert float(table[0]["reward_per_step"]) == pytest.approx(np.mean(rewards))
    with np.load(tmp_path / "out" / "eval-000007.npz") as arrays:  # pickles are refused
        assert arrays["objects"].shape == (STEPS + 1, 5, 16)
        assert arrays["program"][0] == str(steps[-1][3])
        np.testing.assert_array_equal(arrays["step"], np.arange(STEPS + 1))
        expected = [o.stamp_ns / 1e9 for o, *_ in steps[STEPS + 1 :]]
        np.testing.assert_allclose(arrays["stamp_s"], expected)
    assert main(["bag", "export", str(stepped), "--out", str(tmp_path / "out")]) == 2
    assert "exists already" in capsys.readouterr().err


def test_exported_objects_that_are_not_there_are_nan(changing, tmp_path):
    assert main(["bag", "export", str(changing), "--out", str(tmp_path)]) == 0
    steps = [observation.objects for observation, *_ in rearranged()]
    counts = [len(objects) for objects in steps]
    assert len(set(counts)) == 3
    with np.load(tmp_path / "episode-000007.npz") as arrays:
        assert arrays["objects"].shape == (9, max(counts), 16)
        assert arrays["objects"].dtype == np.float32
        for given, objects in zip(arrays["objects"], steps, strict=True):
            np.testing.assert_array_equal(given[: len(objects)], objects)
            assert np.isnan(given[len(objects) :]).all()


def test_a_file_for_rerun_follows_blocks_that_come_and_go(changing, tmp_path):
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    path = tmp_path / "out.rrd"
    assert main(["bag", "export", str(changing), "--rerun", str(path)]) == 0
    told = columns(path)
    with Bag(changing) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    stage = Stage(episode, arena)
    seen: dict[str, int] = {}
    for row in episode.rows:
        stage.show(row)
        for i, block in enumerate(stage.task.episode.blocks, start=1):
            name = name_of(block.kind.words, DESIGN.vocabulary.row).lower().replace(" ", "_")
            (pose,) = told[f"/world/blocks/{name} Transform3D:translation"][seen.get(name, 0)][1]
            assert pose == pytest.approx(stage.task.simulation.positions[i].tolist(), abs=1e-6)
            seen[name] = seen.get(name, 0) + 1
    assert sorted(set(seen.values())) == [2, 6, 9]  # the last one, the one that left, the others


def test_a_file_for_rerun_that_fails_is_not_left_behind(changing, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    path = tmp_path / "out.rrd"

    def show(*_):
        raise RuntimeError("no such scene")

    monkeypatch.setattr(Stage, "show", show)
    with pytest.raises(RuntimeError, match="no such scene"):
        main(["bag", "export", str(changing), "--rerun", str(path)])
    assert not path.exists()


def test_episodes_that_are_not_there_are_said(stepped, tmp_path, capsys):
    chosen = ["bag", "export", str(stepped), "--episodes", "7", "9"]
    assert main([*chosen, "--out", str(tmp_path / "out")]) == 2
    said = "expected episodes that the bag has, got [9], too; 2 others are there"
    assert said in capsys.readouterr().err
    assert (tmp_path / "out" / "eval-000007.npz").exists()
    pytest.importorskip("rerun")
    assert main([*chosen, "--rerun", str(tmp_path / "out.rrd")]) == 2
    assert "got [9], too" in capsys.readouterr().err and not (tmp_path / "out.rrd").exists()
    assert main([*chosen, "--rerun", str(tmp_path / "out.rrd"), "--format", "npz"]) == 2
    assert "expected --out with --format" in capsys.readouterr().err


def test_parquet_holds_the_same_numbers_a_row_for_each_step(stepped, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for kind in ("npz", "parquet"):
        arguments = ["--out", str(tmp_path / kind), "--format", kind]
        assert main(["bag", "export", str(stepped), *arguments]) == 0
    table = parquet.read_table(tmp_path / "parquet" / "eval-000007.parquet")
    shapes = json.loads(table.schema.metadata[b"shapes"])
    with np.load(tmp_path / "npz" / "eval-000007.npz") as arrays:
        assert table.column_names == list(arrays) and table.num_rows == STEPS + 1
        for name, values in arrays.items():
            stored = np.array(table[name].to_pylist())
            np.testing.assert_array_equal(stored.reshape(-1, *shapes[name]), values)


def test_another_format_or_one_without_its_extra_is_refused(stepped, tmp_path, capsys, monkeypatch):
    arguments = ["bag", "export", str(stepped), "--out", str(tmp_path / "out"), "--format"]
    assert main([*arguments, "xls"]) == 2
    assert "expected one of npz, parquet, got 'xls'" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main([*arguments, "parquet"]) == 2
    assert "programmable-agents[parquet]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_transitions_alone_are_exported_too(learned, tmp_path):
    """Without stamps and distances, which transitions don't carry."""
    chosen = ["--episodes", "1", "--out", str(tmp_path)]
    assert main(["bag", "export", str(learned), *chosen]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "episode-000001.npz",
        "episodes.csv",
    ]
    with np.load(tmp_path / "episode-000001.npz") as arrays:
        assert arrays["action"].shape == (101, 6) and np.isnan(arrays["action"][-1]).all()
        assert np.isnan(arrays["reward"][0]) and set(arrays["reward"][1:]) <= {-1.0, 1.0}
        assert np.isnan(arrays["stamp_s"]).all() and np.isfinite(arrays["joint_position"]).all()


def cut_off(bag: Path, copy: Path) -> Path:
    """The bag, with a byte of its last chunk of messages altered: its first episode is whole."""
    shutil.copytree(bag, copy)
    file = next(copy.glob("*.mcap"))
    with file.open("rb") as stream:
        chunk = max(
            make_reader(stream).get_summary().chunk_indexes, key=lambda c: c.chunk_start_offset
        )
    content = bytearray(file.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    file.write_bytes(content)
    return copy


def test_an_export_that_is_refused_does_not_stand_in_the_way(learned, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    chosen = ["bag", "export", str(learned), "--out", str(out), "--episodes"]
    assert main([*chosen, "99"]) == 2
    assert (
        "expected episodes that the bag has, got [99]; none was written" in capsys.readouterr().err
    )
    assert not out.exists()
    assert main([*chosen, "1"]) == 0
    assert (out / "episodes.csv").exists()


def test_a_bag_without_episodes_is_refused(tmp_path, capsys):
    with BagWriter(tmp_path / "bag") as bag:
        for name, kind in (("/object_features", "ObjectFeatures"), ("/arena_info", "ArenaInfo")):
            bag.add(topic(installed_types(), name, f"msgs_schema/msg/{kind}", [reliable_qos(1)]))
        bag.add(topic(installed_types(), "/joint_states", "sensor_msgs/msg/JointState"))
    assert main(["bag", "export", str(tmp_path / "bag"), "--out", str(tmp_path / "out")]) == 2
    assert "expected episodes, got none" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_of_a_damaged_bag_it_is_said_how_many_episodes_were_exported(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pa_ros.bags.run_log.FLUSH_S", 0.0)  # a chunk for each
    assert train(tmp_path / "run", "--record", tmp_path / "bag", frames=300) == 0
    copy, out = cut_off(tmp_path / "bag", tmp_path / "copy"), tmp_path / "out"
    assert main(["bag", "export", str(copy), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "unreadable after" in error and "1 episodes are in" in error
    assert "their table is episodes.csv.part" in error and not (out / "episodes.csv").exists()
    with (out / "episodes.csv.part").open() as file:
        assert [row["episode"] for row in csv.DictReader(file)] == ["0"]
