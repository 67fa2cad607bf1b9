"""Recorded episodes as a LeRobot dataset, version 3: Parquet files, statistics and films.

Layout: `data/…` has a row per frame, `meta/episodes/…` one per episode, `meta/tasks.parquet` the
programs, `meta/stats.json` statistics and `meta/info.json`, which is written last, the description.
Source: https://huggingface.co/docs/lerobot/lerobot-dataset-v3.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.arena import ARMS
from pa_ros.arena.movie import check_movie, write_movie
from pa_ros.arena.render import draw
from pa_ros.bags.episodes import RecordedEpisode, Row, padded
from pa_ros.bags.errors import BagError
from pa_ros.bags.export import pyarrow_with_parquet
from pa_ros.bags.film import RecordedScene
from pa_ros.core.files import write_whole, written_beside
from pa_ros.wire.arena import ArenaDescription

VERSION = "v3.0"
CHUNK = "chunk-{chunk_index:03d}/file-{file_index:03d}"
PER_CHUNK = 1000  # films
CAMERA = "observation.images.top"
HOLD_S = 1.0  # a goal that has held for so long is reached, as in `execute_program`
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}

Columns = dict[str, NDArray[Any]]
Statistics = dict[str, dict[str, list[Any]]]


@dataclass(frozen=True)
class Goal:
    """An episode of the dataset: the steps under one goal, up to its end."""

    rows: list[Row]
    success: bool  # it held for HOLD_S, or when the recorded episode ended


@dataclass(frozen=True)
class Written:
    """The files and counts of an export."""

    episodes: int
    frames: int
    cut: tuple[int, ...]  # numbers of episodes in which steps or actions are missing


def export_lerobot(
    found: Iterable[RecordedEpisode],
    arena: ArenaDescription,
    folder: Path,
    numbers: Collection[int] | None = None,
    side_px: int | None = None,
) -> Written:
    """Write a dataset; a frame is a control step and the action that answered it, an episode a goal
    that was executed.

    With `side_px` each episode gets a film of the table from above, drawn from the recorded states.
    Raises BagError if the folder exists, if no episode can be written or the period is no whole
    number of frames per second; ConfigError for a missing extra.
    """
    pyarrow = pyarrow_with_parquet("export: lerobot")
    if side_px is not None:
        check_movie(folder / "film.mp4")
    if folder.exists():
        raise BagError(f"export: {folder} already exists: name another folder")
    fps = _frames_per_second(arena)
    chosen, cut = _chosen(found, numbers, round(HOLD_S * fps))
    objects = max(len(row.seen.objects) for episode in chosen for row in episode.rows)
    programs = dict.fromkeys(row.step.program for episode in chosen for row in episode.rows)
    tasks = {program: k for k, program in enumerate(programs)}
    start, rows, frames_of = 0, list[dict[str, Any]](), list[Columns]()
    for number, episode in enumerate(chosen):
        columns = _columns(episode, objects) | _indices(episode, number, start, fps, tasks)
        frames = len(columns["action"])
        statistics = {name: _statistics(values) for name, values in columns.items()}
        row = {
            "episode_index": number,
            "tasks": [*dict.fromkeys(row.step.program for row in episode.rows[:-1])],
            "length": frames,
            "dataset_from_index": start,
            "dataset_to_index": start + frames,
            **_place("data", 0),
            **_place("meta/episodes", 0),
        }
        if side_px is not None:
            row |= _place(f"videos/{CAMERA}", number)
            row |= {f"videos/{CAMERA}/from_timestamp": 0.0}
            row |= {f"videos/{CAMERA}/to_timestamp": frames / fps}
            film = folder / f"videos/{CAMERA}" / f"{_file(number)}.mp4"
            statistics[CAMERA] = _film(film, episode, arena, side_px)
        flat = {f"stats/{n}/{k}": v for n, found in statistics.items() for k, v in found.items()}
        rows.append({**row, **flat})
        frames_of.append(columns)
        start += frames
    joined = {name: np.concatenate([c[name] for c in frames_of]) for name in columns}
    for name, table in (
        (f"data/{_file(0)}", _table(pyarrow, joined)),
        (f"meta/episodes/{_file(0)}", pyarrow.Table.from_pylist(rows)),
        ("meta/tasks", _tasks(pyarrow, tasks)),
    ):
        with written_beside(folder / f"{name}.parquet") as beside:
            pyarrow.parquet.write_table(table, beside)
    write_whole(folder / "meta/stats.json", json.dumps(_joined(rows), indent=1))
    about = {
        "codebase_version": VERSION,
        "robot_type": arena.arm,
        "total_episodes": len(chosen),
        "total_frames": start,
        "total_tasks": len(tasks),
        "chunks_size": PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(chosen)}"},
        "data_path": f"data/{CHUNK}.parquet",
        "video_path": None if side_px is None else f"videos/{{video_key}}/{CHUNK}.mp4",
        "features": _features(columns, arena, side_px, fps),
    }
    write_whole(folder / "meta/info.json", json.dumps(about, indent=1))
    return Written(len(chosen), start, tuple(cut))


def _chosen(
    found: Iterable[RecordedEpisode], numbers: Collection[int] | None, hold: int
) -> tuple[list[Goal], list[int]]:
    """The goals of the wanted episodes, and the numbers of episodes that are not whole."""
    parts = list(_executed(found))
    wanted = [one for one in parts if numbers is None or one[0].number in numbers]
    if missing := sorted(set(numbers or ()) - {episode.number for episode, _ in wanted}):
        raise BagError(f"export: the bag does not contain episodes {missing}")
    chosen, cut = list[Goal](), list[int]()
    for episode, of_goals in wanted:
        goals = (_until_its_end(rows, hold) for rows in of_goals)
        chosen += [goal for goal in goals if len(goal.rows) > 1]
        if any(
            before.step.program and not _joined_to(before, row)
            for before, row in pairwise(episode.rows)
        ):
            cut.append(episode.number)
    if not chosen:
        text = f"export: expected steps with actions, got none in episodes {cut}"
        raise BagError(text, code="bag.foreign")
    return chosen, cut


def _frames_per_second(arena: ArenaDescription) -> int:
    fps = round(1 / arena.control_period)
    if abs(fps * arena.control_period - 1) > 1e-6:
        raise BagError(
            "export: lerobot: expected a whole number of frames per second, got a period of "
            f"{arena.control_period} s"
        )
    return fps


def _indices(episode: Goal, number: int, start: int, fps: int, tasks: Mapping[str, int]) -> Columns:
    """Where each frame of an episode is: in time, in it, and among all, of which `start` precede
    it."""
    frames = len(episode.rows) - 1
    return {
        "timestamp": (np.arange(frames) / fps).astype(np.float32),
        "frame_index": np.arange(frames),
        "episode_index": np.full(frames, number),
        "index": np.arange(start, start + frames),
        "task_index": np.array([tasks[row.step.program] for row in episode.rows[:-1]]),
    }


def _executed(
    found: Iterable[RecordedEpisode],
) -> Iterator[tuple[RecordedEpisode, list[list[Row]]]]:
    """Each episode with the rows under each of its programs.

    A program that is left from the episode before, and soon replaced, was not meant for this one.
    """
    before = None
    for episode in found:
        parts = _parts(episode.rows)
        left = len(parts) > 1 and _goal(parts[0][0]) == before
        before = _goal(parts[-1][0]) if parts else None
        yield episode, parts[left:]


def _parts(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows under each program, cut where steps or actions are missing."""
    parts: list[list[Row]] = []
    for before, row in pairwise([None, *rows]):
        assert row is not None
        same = before is not None and _joined_to(before, row) and _goal(before) == _goal(row)
        if not same:
            parts.append([])
        parts[-1].append(row)
    return [part for part in parts if part[0].step.program]


def _goal(row: Row) -> tuple[str, str]:
    return row.seen.program_id, row.step.program


def _joined_to(before: Row, row: Row) -> bool:
    """Whether a row's action led to the other row."""
    return len(before.action) > 0 and row.seen.step == before.seen.step + 1


def _until_its_end(rows: list[Row], hold: int) -> Goal:
    """A goal's rows until it has held for so many steps, cannot hold any more, or is given up."""
    held = 0
    for count, row in enumerate(rows, 1):
        verdict = row.step.verdict
        held = held + 1 if verdict is not None and verdict.satisfied else 0
        if held > hold or (verdict is not None and (verdict.truncated or verdict.violated)):
            return Goal(rows[:count], held > 0)
        # An agent that gives a goal up commands the arm to hold.
        joints = len(row.seen.joint_position)
        if count > 1 and len(row.action) and not row.action[:joints].any():
            return Goal(rows[:count], False)
    return Goal(rows, False)


def _columns(episode: Goal, objects: int) -> Columns:
    """The frames of an episode; absent blocks are zero."""
    taken, following = episode.rows[:-1], episode.rows[1:]
    state = [
        # A gripper's number follows the hand's pose.
        np.concatenate([row.seen.joint_position, row.seen.joint_velocity, row.seen.hand_pose[7:]])
        for row in taken
    ]
    columns = {
        "observation.state": np.array(state, np.float32),
        "observation.environment_state": padded(taken, objects, 0.0).reshape(len(taken), -1),
        "action": np.array([row.action for row in taken], np.float32),
        "next.done": np.arange(len(taken)) == len(taken) - 1,
    }
    if all(row.step.verdict is not None for row in following):
        columns["next.success"] = columns["next.done"] & episode.success
    reward = np.array([row.reward for row in following], np.float32)
    return columns if np.isnan(reward).any() else {**columns, "next.reward": reward}


def _features(
    columns: Columns, arena: ArenaDescription, side_px: int | None, fps: int
) -> dict[str, Any]:
    joints = list(ARMS[arena.arm].joint_names)
    width = arena.world.object_features
    count = columns["observation.environment_state"].shape[1] // width
    gripper = ["gripper"] * arena.world.gripper
    of_joints = columns["action"].shape[1] == arena.world.commands
    action = joints if of_joints else ["outward", "left", "up"]
    names = {
        "observation.state": [
            *(f"{j}.{k}" for k in ("position", "velocity") for j in joints),
            *(f"{name}.holds" for name in gripper),
        ],
        "observation.environment_state": [
            f"object{i}.{name}" for i in range(count) for name in arena.world.schema.feature_names
        ],
        "action": [*action, *gripper],
    }
    features: dict[str, Any] = {
        name: {
            "dtype": str(values.dtype),
            "shape": list(values.shape[1:]) or [1],
            "names": names.get(name),
        }
        for name, values in columns.items()
    }
    if side_px is not None:
        about = {"codec": "h264", "pix_fmt": "yuv420p", "fps": fps, "height": side_px,
                 "width": side_px, "channels": 3, "is_depth_map": False}  # fmt: skip
        features[CAMERA] = {
            "dtype": "video",
            "shape": [side_px, side_px, 3],
            "names": ["height", "width", "channels"],
            "info": {**{f"video.{k}": v for k, v in about.items()}, "has_audio": False},
        }
    return features


def _film(path: Path, episode: Goal, arena: ArenaDescription, side_px: int) -> dict[str, list[Any]]:
    """Write the film of an episode's frames; returns the statistics of a tenth of its pictures."""
    scene, sampled = RecordedScene(arena, episode.rows[0].step), list[NDArray[Any]]()

    def pictures() -> Iterable[NDArray[np.uint8]]:
        for k, row in enumerate(episode.rows[:-1]):
            scene.show(row.step)
            picture = draw(scene.task, side_px, rendered=False)
            if k % 10 == 0:
                sampled.append(picture.reshape(-1, 3) / 255.0)
            yield picture

    write_movie(path, pictures(), arena.control_period)
    found = _statistics(np.concatenate(sampled))
    shaped = {k: np.reshape(v, (3, 1, 1)).tolist() for k, v in found.items() if k != "count"}
    return {**shaped, "count": [len(sampled)]}


def _statistics(values: NDArray[Any]) -> dict[str, list[Any]]:
    """Statistics over the first axis, for each element."""
    flat = values.reshape(len(values), -1).astype(np.float64)
    quantiles = np.quantile(flat, [*QUANTILES.values()], axis=0).tolist()
    ends = {"min": flat.min(0), "max": flat.max(0), "mean": flat.mean(0), "std": flat.std(0)}
    found = {name: value.tolist() for name, value in ends.items()}
    return {**found, "count": [len(flat)], **dict(zip(QUANTILES, quantiles, strict=True))}


def _joined(rows: list[dict[str, Any]]) -> Statistics:
    """Statistics of all episodes, from those of each; quantiles are means, as LeRobot has them."""
    features = [key.split("/")[1] for key in rows[0] if key.endswith("/count")]
    joined: Statistics = {}
    for name in features:
        of = {
            k: np.array([row[f"stats/{name}/{k}"] for row in rows], np.float64)
            for k in ("min", "max", "mean", "std", "count", *QUANTILES)
        }
        shape = (-1, *[1] * (of["mean"].ndim - 1))
        weights = of["count"].reshape(shape) / of["count"].sum()
        mean = (weights * of["mean"]).sum(0)
        variance = (weights * (of["std"] ** 2 + (of["mean"] - mean) ** 2)).sum(0)
        joined[name] = {
            "min": of["min"].min(0).tolist(),
            "max": of["max"].max(0).tolist(),
            "mean": mean.tolist(),
            "std": np.sqrt(variance).tolist(),
            "count": [int(of["count"].sum())],
            **{k: (weights * of[k]).sum(0).tolist() for k in QUANTILES},
        }
    return joined


def _file(number: int) -> str:
    return CHUNK.format(chunk_index=number // PER_CHUNK, file_index=number % PER_CHUNK)


def _place(prefix: str, number: int) -> dict[str, int]:
    chunk, file = divmod(number, PER_CHUNK)
    return {f"{prefix}/chunk_index": chunk, f"{prefix}/file_index": file}


def _table(pyarrow: Any, columns: Mapping[str, NDArray[Any]]) -> Any:
    return pyarrow.table({
        name: values
        if values.ndim == 1
        else pyarrow.FixedSizeListArray.from_arrays(values.ravel(), values.shape[1])
        for name, values in columns.items()
    })  # fmt: skip


def _tasks(pyarrow: Any, tasks: Mapping[str, int]) -> Any:
    """Programs as the index of a table for pandas, which LeRobot reads it by."""
    index = {"name": "task", "field_name": "task", "pandas_type": "unicode",
             "numpy_type": "object", "metadata": None}  # fmt: skip
    column = {"name": "task_index", "field_name": "task_index", "pandas_type": "int64",
              "numpy_type": "int64", "metadata": None}  # fmt: skip
    about = {"index_columns": ["task"], "column_indexes": [], "columns": [column, index]}
    table = pyarrow.table({"task_index": [*tasks.values()], "task": [*tasks]})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})
