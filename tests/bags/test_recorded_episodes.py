"""Episodes of a bag: described, exported and filmed as they were recorded."""

import csv
import errno
import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from helpers.pictures import captions
from helpers.recordings import STEPS, acted, rearranged, rewritten
from pa_ros.bags.episodes import RecordedEpisode, episodes
from pa_ros.bags.experience import arenas_of
from pa_ros.bags.export import export as export_episodes
from pa_ros.bags.film import RecordedScene
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main

pytestmark = pytest.mark.xdist_group("recorded episodes")  # their recordings are made once


def export(bag: Path, *arguments: str | Path) -> int:
    return main(["bag", "export", str(bag), *map(str, arguments)])


def first_episode(path: Path) -> tuple[RecordedEpisode, RecordedScene]:
    with Bag(path) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    return episode, RecordedScene(arena, episode.rows[0].step)


def test_the_parts_of_each_step_are_joined(stepped):
    with Bag(stepped) as bag:
        found = list(episodes(bag))
    assert [(e.number, e.evaluation, len(e.rows), e.missing) for e in found] == [
        (7, False, STEPS + 1, 0), (7, True, STEPS + 1, 0),
    ]  # fmt: skip
    rows = [row for episode in found for row in episode.rows]
    for row, (observation, verdict, command, program, _) in zip(rows, acted(), strict=True):
        assert (row.seen.step, row.step.program) == (observation.step, str(program))
        np.testing.assert_array_equal(row.seen.objects, observation.objects)
        np.testing.assert_array_equal(row.seen.joint_position, observation.joint_position)
        np.testing.assert_array_equal(row.seen.joint_velocity, observation.joint_velocity)
        assert (row.reward, row.distance) == (verdict.reward, verdict.distance)
        if command is None:
            assert len(row.action) == 0 and row.policy_version == -1
        else:
            np.testing.assert_array_equal(row.action, command.action)
            assert row.policy_version == 4


def test_samples_and_what_a_camera_saw_are_not_taken_for_the_arenas_steps(stepped):
    with Bag(stepped) as bag:
        before, steps = [len(one.rows) for one in episodes(bag)], "/object_features"
        for beside in ("/samples", "/seen"):
            bag.types[beside + steps] = bag.types[steps]
        assert bag.topic_of(bag.types[steps]) == steps
        assert [len(one.rows) for one in episodes(bag)] == before


def test_a_comparison_is_made_anew_at_each_step(stepped):
    episode, stage = first_episode(stepped)
    text = "NEAR(HAND, LEFTMOST(OR(CUBE, NOT(CUBE))))"
    step = replace(episode.rows[0].step, program=text)
    stage.show(step)
    (leftmost,) = stage.task.verifier.targets
    seen = step.observation
    objects = seen.objects.copy()
    objects[1:] = objects[:0:-1]  # in the opposite order
    objects[1:, 7:] = seen.objects[1:, 7:]
    stage.show(replace(step, observation=replace(seen, objects=objects)))
    assert stage.task.verifier.targets == (len(objects) - leftmost,)


def test_info_describes_episodes_versions_and_provenance(learned, stepped, capsys):
    assert main(["bag", "info", str(learned)]) == 0
    out = capsys.readouterr().out
    assert "3 trajectories of transitions, no gaps" in out
    assert "weights: versions 0 to 3" in out and "3 training episodes, 300 steps" in out
    assert "2-L, jaco, fast, seed 5" in out and "from scratch" in out
    assert main(["bag", "info", str(stepped)]) == 0
    out = capsys.readouterr().out
    assert "1 training episodes, 30 steps, reward per step" in out
    assert "1 evaluation episodes, 30 steps" in out and "acted by versions 4 to 4" in out


def test_info_names_gaps(learned, stepped, tmp_path, capsys):
    def drop(name, message):
        gone = name == "/trajectories" and message.sequence == 1
        if name == "/trajectories":
            message.sequence += 5
        return [] if gone or (name == "/policy_weights" and message.version == 2) else [message]

    assert main(["bag", "info", str(rewritten(learned, tmp_path / "a", drop))]) == 0
    out = capsys.readouterr().out
    assert "2 trajectories of transitions; GAPS: 1 missing of agent" in out
    assert "versions 0 to 3, 1 of them not recorded" in out

    def lose(name, message):
        gone = name == "/object_features" and message.step in (0, 4, 5, 6)
        return [] if gone and not message.evaluation else [message]

    assert main(["bag", "info", str(rewritten(stepped, tmp_path / "b", lose))]) == 0
    assert "GAPS: 3 steps between others are not recorded" in capsys.readouterr().out


def test_a_step_that_is_not_what_its_definition_promises_is_named(stepped, tmp_path, capsys):
    def damage(name, message):
        if name == "/object_features":
            message.distance = -1.0
        return [message]

    bag = rewritten(stepped, tmp_path / "damaged", damage)
    assert main(["bag", "info", str(bag)]) == 1
    assert "NOT READABLE: object_features.distance" in capsys.readouterr().out
    assert export(bag, "--out", tmp_path / "out") == 2
    assert "object_features.distance" in capsys.readouterr().err


def test_exported_arrays_are_what_was_recorded(stepped, tmp_path, capsys):
    assert export(stepped, "--out", tmp_path / "out") == 0
    with (tmp_path / "out" / "episodes.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["file"] for row in table] == ["episode-000007.npz", "eval-000007.npz"]
    steps = acted()
    rewards = [verdict.reward for _, verdict, *_ in steps[1 : STEPS + 1]]
    assert float(table[0]["reward_per_step"]) == pytest.approx(np.mean(rewards))
    assert [(row["steps"], row["missing_steps"]) for row in table] == [(str(STEPS), "0")] * 2
    with np.load(tmp_path / "out" / "eval-000007.npz") as arrays:  # without pickles
        assert arrays["objects"].shape == (STEPS + 1, 5, 16)
        assert arrays["program"][0] == str(steps[-1][3])
        np.testing.assert_array_equal(arrays["step"], np.arange(STEPS + 1))
        expected = [o.stamp_ns / 1e9 for o, *_ in steps[STEPS + 1 :]]
        np.testing.assert_allclose(arrays["stamp_s"], expected)
    assert export(stepped, "--out", tmp_path / "out") == 2
    assert "already exists" in capsys.readouterr().err
    twice = [first_episode(stepped)[0]] * 2
    assert export_episodes(twice, tmp_path / "twice") == 2
    assert {p.stem for p in (tmp_path / "twice").glob("*.npz")} == {
        "episode-000007", "episode-000007-2"
    }  # fmt: skip


def test_exported_objects_that_are_absent_are_nan(changing, tmp_path):
    assert export(changing, "--out", tmp_path) == 0
    steps = [observation.objects for observation, *_ in rearranged()]
    counts = [len(objects) for objects in steps]
    assert len(set(counts)) == 3
    with np.load(tmp_path / "episode-000007.npz") as arrays:
        assert arrays["objects"].shape == (9, max(counts), 16)
        assert arrays["objects"].dtype == np.float32
        for given, objects in zip(arrays["objects"], steps, strict=True):
            np.testing.assert_array_equal(given[: len(objects)], objects)
            assert np.isnan(given[len(objects) :]).all()


def test_transitions_alone_are_exported_without_stamps(learned, tmp_path):
    def number(name, message):
        if name == "/trajectories":
            message.rewards = message.first_step + np.arange(len(message.rewards), dtype=np.float32)
        return [message]

    bag = rewritten(learned, tmp_path / "bag", number)
    with Bag(bag) as opened:
        assert "/learner_info" in opened.types
    assert export(bag, "--episodes", "1", "--out", tmp_path / "out") == 0
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"episode-000001.npz", "episodes.csv"}
    with np.load(tmp_path / "out/episode-000001.npz") as arrays:
        assert arrays["action"].shape == (101, 6) and np.isnan(arrays["action"][-1]).all()
        np.testing.assert_array_equal(arrays["reward"], [np.nan, *range(100)])
        assert np.isnan(arrays["stamp_s"]).all() and np.isfinite(arrays["joint_position"]).all()


def test_parquet_holds_the_same_numbers_with_a_row_per_step(stepped, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for kind in ("npz", "parquet"):
        assert export(stepped, "--out", tmp_path / kind, "--format", kind) == 0
    table = parquet.read_table(tmp_path / "parquet" / "eval-000007.parquet")
    shapes = json.loads(table.schema.metadata[b"shapes"])
    with np.load(tmp_path / "npz" / "eval-000007.npz") as arrays:
        assert table.column_names == list(arrays) and table.num_rows == STEPS + 1
        for name, values in arrays.items():
            stored = np.array(table[name].to_pylist())
            np.testing.assert_array_equal(stored.reshape(-1, *shapes[name]), values)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--out", "OUT", "--format", "xls"], "expected one of npz, parquet, got 'xls'"),
        (["--out", "OUT", "--format", "parquet"], "programmable-agents[parquet]"),
        (["--lerobot", "OUT", "--format", "npz"], "expected --out with --format"),
        ([], "expected one of --out DIR and --lerobot DIR"),
        (["--out", "OUT", "--episodes", "99"], "does not contain episodes [99]; 0 others"),
    ],
)
def test_a_wrong_export_is_rejected_and_leaves_nothing(
    stepped, tmp_path, capsys, monkeypatch, arguments, said
):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    given = [one.replace("OUT", str(tmp_path / "out")) for one in arguments]
    assert export(stepped, *given) == 2
    assert said in capsys.readouterr().err and not [*tmp_path.iterdir()]


def test_an_export_that_fails_leaves_no_file_under_its_final_name(
    stepped, tmp_path, capsys, monkeypatch
):
    def fail(path: Path, **_: object) -> None:
        path.write_bytes(b"some")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savez_compressed", fail)
    assert export(stepped, "--out", tmp_path / "out") == 2
    assert "No space left" in capsys.readouterr().err and not [*(tmp_path / "out").iterdir()]


def test_the_stage_shows_what_was_recorded(stepped, learned, changing):
    """The features of the drawn scene are those recorded: blocks and hand are in place."""
    for path, every in ((stepped, 7), (learned, 7), (changing, 1)):
        episode, stage = first_episode(path)
        for row in episode.rows[::every]:
            stage.show(row.step)
            given = stage.task.simulation.objects()
            np.testing.assert_allclose(given[:, :3], row.seen.objects[:, :3], atol=1e-5)
            turned = np.abs(np.sum(given[:, 3:7] * row.seen.objects[:, 3:7], axis=1))
            np.testing.assert_allclose(turned, 1.0, atol=1e-5)
            np.testing.assert_array_equal(given[:, 7:], row.seen.objects[:, 7:])


def film(bag: Path, out: Path, *arguments: str) -> int:
    chosen = ["--episode", "7", "--width", "64", "--out", str(out)]
    return main(["bag", "film", str(bag), *chosen, *arguments])


def test_a_film_has_a_picture_of_each_step_at_the_arenas_speed(
    stepped, tmp_path, capsys, monkeypatch
):
    out, said = tmp_path / "film.gif", captions(monkeypatch, "pa_ros.bags.film.captioned")
    assert film(stepped, out, "--evaluation") == 0
    _, verdict, *_ = acted()[STEPS + 3]
    told = f"reward {verdict.reward:+.2f}   distance {verdict.distance:.2f} m"
    assert said[2] == (str(acted()[-1][3]), f"step 2   {told}") and len(said) == STEPS + 1
    with Image.open(out) as picture:
        assert picture.format == "GIF" and picture.size[0] == 64
        assert picture.info["duration"] == 100
        pictures = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(picture)]
    assert (pictures[-1] != pictures[0]).any()
    assert STEPS // 2 < len(pictures) <= STEPS + 1  # equal pictures in a row are stored once
    assert film(stepped, out, "--episode", "8") == 2
    assert "expected an episode that was recorded, got 8" in capsys.readouterr().err
    assert film(stepped, tmp_path / "film.avi") == 2
    said = capsys.readouterr().err
    assert "expected a file name that ends in .webp, .gif, .mp4, got '.avi'" in said


@pytest.mark.parametrize("text", ["", "a-program-id", "NEAR(HAND, AND(CYLINDER, CAPSULE))"])
def test_a_film_shows_a_target_only_while_one_is_known(stepped, text):
    episode, stage = first_episode(stepped)
    for row in episode.rows[:4] + episode.rows[5:]:
        row.step = replace(row.step, program=text)
    targets = []
    for row in episode.rows[:9]:
        stage.show(row.step)
        targets.append(len(stage.task.verifier.targets))
    assert episode.rows[4].step.program and targets == [0] * 4 + [1] + [0] * 4
