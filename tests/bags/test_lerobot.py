"""A LeRobot dataset, read as its documentation describes it."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.recordings import STEPS, Acted, acted, recorded, rewritten
from pa_ros.bags.episodes import episodes
from pa_ros.bags.errors import BagError
from pa_ros.bags.experience import newest_arena
from pa_ros.bags.lerobot import export_lerobot
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main

pytestmark = pytest.mark.xdist_group("recorded episodes")
pq = pytest.importorskip("pyarrow.parquet", reason="the extra `parquet` is not installed")
pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
CAMERA = "observation.images.top"


@pytest.fixture(scope="module")
def dataset(stepped, tmp_path_factory):
    pytest.importorskip("av", reason="the extra `film` is not installed")
    folder = tmp_path_factory.mktemp("lerobot") / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pa_ros.bags.lerobot.PER_CHUNK", 1)  # films
        assert main(["bag", "export", str(stepped), "--lerobot", str(folder), "--video", "32"]) == 0
    return folder


def described(folder):
    return json.loads((folder / "meta/info.json").read_text())


def test_frames_are_the_recorded_steps_with_the_actions_that_answered_them(dataset, stepped):
    info = described(dataset)
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 10, "jaco")
    with Bag(stepped) as bag:
        recorded = [episode.arrays() for episode in episodes(bag)]
    assert info["total_frames"] == len(recorded) * STEPS == 2 * STEPS
    path = dataset / info["data_path"].format(chunk_index=0, file_index=0)
    frames = pandas.read_parquet(path)
    assert {*frames.columns} == {*info["features"]} - {CAMERA}
    np.testing.assert_array_equal(frames["index"], np.arange(2 * STEPS))
    expected = np.concatenate([arrays["action"][:-1] for arrays in recorded])
    np.testing.assert_array_equal(np.stack(frames["action"]), expected)
    rewards = np.concatenate([arrays["reward"][1:] for arrays in recorded])
    np.testing.assert_array_equal(frames["next.reward"], rewards.astype(np.float32))
    np.testing.assert_allclose(frames["timestamp"], frames["frame_index"] / 10, rtol=1e-6)
    assert frames["next.done"].sum() == 2
    for name, feature in info["features"].items():
        if name != CAMERA:
            one = np.asarray(frames[name][0])
            assert (list(one.shape) or [1]) == feature["shape"], name
            assert feature["names"] is None or len(feature["names"]) == one.size


def test_episodes_say_where_their_frames_and_programs_are(dataset):
    info = described(dataset)
    rows = pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tasks = pandas.read_parquet(dataset / "meta/tasks.parquet")
    frames = pandas.read_parquet(dataset / "data/chunk-000/file-000.parquet")
    assert len(rows) == info["total_episodes"] and len(tasks) == info["total_tasks"]
    for row in rows:
        own = frames[row["dataset_from_index"] : row["dataset_to_index"]]
        assert len(own) == row["length"] and {*own["episode_index"]} == {row["episode_index"]}
        assert {*own["task_index"]} == {*tasks.loc[row["tasks"]]["task_index"]}
        assert row["tasks"][0].startswith("NEAR(HAND, ")
        assert row[f"videos/{CAMERA}/from_timestamp"] == 0.0
        assert row[f"videos/{CAMERA}/to_timestamp"] == pytest.approx(row["length"] / 10)
        state = np.stack(own["observation.state"]).astype(np.float64)
        quantile = row["stats/observation.state/q10"]
        np.testing.assert_allclose(quantile, np.quantile(state, 0.1, axis=0), atol=1e-9)
    assert [row["dataset_from_index"] for row in rows] == [0, STEPS]
    assert info["splits"] == {"train": "0:2"} and info["chunks_size"] == 1
    places = [row[f"videos/{CAMERA}/chunk_index"] for row in rows]
    assert places == [0, 1] and {row["data/chunk_index"] for row in rows} == {0}


def executed(goal: str, steps: list[Acted], reached: int = 99, given_up: int = 99) -> list[Any]:
    """Steps under a goal that holds from one of them on, or is given up at another."""
    found = list[Any]()
    for k, (seen, verdict, command, program, _) in enumerate(steps):
        holds = command and k >= given_up
        found.append((
            replace(seen, program_id=goal),
            replace(verdict, satisfied=k >= reached),
            replace(command, action=0 * command.action) if holds else command,
            program if goal else "", False,
        ))  # fmt: skip
    return found


def test_a_goal_left_from_the_episode_before_is_no_episode(tmp_path):
    steps = [one for one in acted() if not one[-1]]
    old = [(replace(seen, episode=1), *rest) for seen, *rest in executed("a", steps[:9])]
    left = [(replace(seen, episode=2), *rest) for seen, *rest in executed("a", steps[9:14])]
    new = [(replace(seen, episode=2), *rest) for seen, *rest in executed("b", steps[14:20])]
    bag = recorded(tmp_path / "bag", [*old, *left, *new])
    assert main(["bag", "export", str(bag), "--lerobot", str(tmp_path / "set")]) == 0
    frames = pandas.read_parquet(tmp_path / "set/data/chunk-000/file-000.parquet")
    assert frames.groupby("episode_index").size().tolist() == [8, 5]


def test_an_executed_goal_is_an_episode_up_to_its_end_with_its_success(tmp_path):
    steps = [one for one in acted() if not one[-1]]
    goals = executed("a", steps[3:16], reached=1), executed("b", steps[16:], given_up=9)
    bag = recorded(tmp_path / "bag", [*executed("", steps[:3]), *goals[0], *goals[1]])
    assert main(["bag", "export", str(bag), "--lerobot", str(tmp_path / "set")]) == 0
    frames = pandas.read_parquet(tmp_path / "set/data/chunk-000/file-000.parquet")
    first, second = (part for _, part in frames.groupby("episode_index"))
    assert (len(first), len(second)) == (11, 9)  # after 1 s of holding, and at the first rest
    assert first["next.success"].tolist() == [False] * 10 + [True]
    assert not second["next.success"].any() and second["next.done"].tolist()[-1]
    action = np.stack(first["action"])
    np.testing.assert_array_equal(action[0], steps[3][2].action)


def test_statistics_are_those_of_all_frames(dataset):
    found = json.loads((dataset / "meta/stats.json").read_text())
    frames = pandas.read_parquet(dataset / "data/chunk-000/file-000.parquet")
    state = np.stack(frames["observation.state"]).astype(np.float64)
    own = found["observation.state"]
    for name, value in (("min", state.min(0)), ("max", state.max(0)), ("mean", state.mean(0)),
                        ("std", state.std(0))):  # fmt: skip
        np.testing.assert_allclose(own[name], value, atol=1e-9)
    assert own["count"] == [len(frames)] and np.shape(found[CAMERA]["mean"]) == (3, 1, 1)
    halves = [np.quantile(half, 0.9, axis=0) for half in np.split(state, 2)]
    np.testing.assert_allclose(own["q90"], np.mean(halves, axis=0), atol=1e-9)
    assert found[CAMERA]["count"] == [2 * 3] and 0.9 < np.max(found[CAMERA]["max"]) <= 1.0


def test_films_have_a_picture_for_each_frame(dataset):
    import av

    info = described(dataset)
    feature = info["features"][CAMERA]
    about = dict(codec="h264", pix_fmt="yuv420p", fps=10, height=32, width=32, channels=3)
    about = {f"video.{name}": value for name, value in about.items()}
    assert feature["info"] == about | {"video.is_depth_map": False, "has_audio": False}
    assert (feature["shape"], feature["dtype"]) == ([32, 32, 3], "video")
    for row in pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist():
        place = {k: row[f"videos/{CAMERA}/{k}"] for k in ("chunk_index", "file_index")}
        path = dataset / info["video_path"].format(video_key=CAMERA, **place)
        with av.open(str(path)) as film:
            times = [frame.time for frame in film.decode(video=0)]
        np.testing.assert_allclose(times, np.arange(row["length"]) / 10)


def test_episodes_are_cut_where_steps_or_actions_are_missing(changing, stepped, tmp_path, capsys):
    assert main(["bag", "export", str(changing), "--lerobot", str(tmp_path / "changing")]) == 2
    assert "expected steps with actions, got none" in capsys.readouterr().err
    cut = rewritten(stepped, tmp_path / "cut", without_a_step)
    assert main(["bag", "export", str(cut), "--lerobot", str(tmp_path / "set")]) == 1
    assert "cut, because steps or actions are missing: [7]" in capsys.readouterr().out
    assert described(tmp_path / "set")["total_episodes"] == 3
    other = ["--lerobot", str(tmp_path / "other"), "--episodes", "7", "99"]
    assert main(["bag", "export", str(stepped), *other]) == 2
    assert "does not contain episodes [99]" in capsys.readouterr().err
    assert main(["bag", "export", str(stepped), "--lerobot", str(tmp_path / "set")]) == 2
    assert "already exists: name another folder" in capsys.readouterr().err


def test_a_period_that_no_film_has_is_rejected(stepped, tmp_path):
    with Bag(stepped) as bag:
        arena = replace(newest_arena(bag), control_period=0.03)
        with pytest.raises(BagError, match="whole number of frames per second, got .* 0.03 s"):
            export_lerobot(episodes(bag), arena, tmp_path / "set")


def without_a_step(topic, message):
    lost = topic == "/object_features" and message.step == 4 and not message.evaluation
    return [] if lost else [message]
