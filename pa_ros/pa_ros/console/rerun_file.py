"""Writes a recording as one file for Rerun's viewer: poses, p, programs and rewards."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pa_ros.bags.episodes import RecordedEpisode
from pa_ros.bags.errors import BagError
from pa_ros.bags.film import Stage
from pa_ros.console.moment import Moment
from pa_ros.console.replay import Replay
from pa_ros.core.errors import ConfigError, needs_extra
from pa_ros.core.experience import Float64
from pa_ros.core.files import written_beside
from pa_ros.wire.arena import ArenaDescription

Shown = list[tuple[int, str]]
_BOX, _SPHERE = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_SPHERE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)


def write_rerun(replay: Replay, path: Path, numbers: Collection[int] | None = None) -> int:
    """Write episodes, all or those of some numbers, on one time line; return how many.

    Raises ConfigError if `path` is not .rrd or the extra is missing; BagError if `path` exists, the
    bag lacks some of `numbers`, or joint positions are not recorded.
    """
    rerun = _rerun()
    if path.suffix != ".rrd":
        raise ConfigError(f"export: expected a file that ends in .rrd, got {path}")
    if path.exists():
        raise BagError(f"export: {path} already exists and is not overwritten: name another file")
    if missing := sorted(set(numbers or ()) - {episode.number for episode in replay.episodes}):
        raise BagError(f"export: the bag does not contain episodes {missing}")
    chosen = [
        (place, episode)
        for place, episode in enumerate(replay.episodes)
        if numbers is None or episode.number in numbers
    ]
    with (
        written_beside(path) as beside,
        rerun.RecordingStream("pa_ros", recording_id=path.stem) as stream,
    ):
        stream.save(str(beside))
        stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        writer = _EpisodeWriter(rerun, stream, replay.arena)
        for place, episode in chosen:
            moments = [replay.moment(place, step) for step in range(len(episode.rows))]
            writer.write(episode, moments)
        stream.flush()
    return len(chosen)


class _EpisodeWriter:
    """Writes episode after episode; the steps of each entity are columns."""

    def __init__(self, rerun: Any, stream: Any, arena: ArenaDescription) -> None:
        self._rerun, self._stream, self._arena = rerun, stream, arena
        self._texts: dict[str, str] = {}  # the newest of each entity
        self._blocks: list[str] = []  # names of those on the table
        self._until_s = -arena.control_period  # simulation time written so far

    def write(self, episode: RecordedEpisode, moments: Sequence[Moment]) -> None:
        """Write one episode, in a new part wherever its blocks change."""
        stage = Stage(episode, self._arena)
        for _, part in groupby(moments, lambda moment: moment.row.looks):
            self._write_part(stage, list(part))

    def _write_part(self, stage: Stage, moments: Sequence[Moment]) -> None:
        """Write consecutive steps with the same blocks."""
        stage.show(moments[0].row)
        self._times = self._timelines(moments)
        kinds = moments[0].names
        shown = _shown(stage.task.simulation.model, self._begin(kinds))
        self._write_shapes(stage, shown, kinds, _relevance(moments))
        self._write_poses(stage, shown, moments)
        self._write_numbers("reward", [moment.reward for moment in moments])
        self._write_numbers("distance", [moment.distance for moment in moments])
        for i, moment in enumerate(moments):
            self._write_text(i, "program", moment.program or "none in force")
            self._write_text(i, "verdict", moment.verdict)

    def _timelines(self, moments: Sequence[Moment]) -> dict[str, dict[str, NDArray[Any]]]:
        """Return simulation time, step and episode of each step.

        If the time is not recorded, the steps follow each other at the control period.
        """
        seen, period_s = [moment.observation for moment in moments], self._arena.control_period
        stamps: Float64 = np.array([one.stamp_ns / 1e9 for one in seen], dtype=np.float64)
        if not stamps[-1] > 0:
            later = self._until_s + period_s * np.arange(1, len(seen) + 1)
            stamps = later.astype(np.float64)
        self._until_s = float(stamps[-1])
        return {
            "sim_time": {"duration": stamps},
            "step": {"sequence": np.array([one.step for one in seen])},
            "episode": {"sequence": np.array([one.episode for one in seen])},
        }

    def _begin(self, kinds: Sequence[str]) -> list[str]:
        """Return names for the blocks, and clear the entities of blocks that are gone."""
        before, self._blocks = self._blocks, []
        for kind in kinds:
            name = kind.lower().replace(" ", "_")
            known = sum(one.rpartition("-")[0] == name or one == name for one in self._blocks)
            self._blocks.append(f"{name}-{known + 1}" if known else name)
        self._at(0)
        for gone in sorted(set(before) - set(self._blocks)):
            self._stream.log(f"world/blocks/{gone}", self._rerun.Clear(recursive=False))
            self._stream.log(f"p/{gone}", self._rerun.Clear(recursive=False))
        return self._blocks

    def _write_shapes(
        self, stage: Stage, shown: Shown, kinds: Sequence[str], relevance: Float64
    ) -> None:
        """Write the solids at the first step, and the labels of blocks, which change with p."""
        self._at(0)
        for number, entity in shown:
            shape = _shape(self._rerun, stage.task.simulation.model, number)
            self._stream.log(entity, shape)
            name = entity.rpartition("/")[2]
            if name in self._blocks:
                block = self._blocks.index(name)
                labels = [f"{kinds[block]}{_degree(p)}" for p in relevance[:, block]]
                columns = type(shape).columns(labels=labels, show_labels=[True] * len(labels))
                self._stream.send_columns(entity, self._indexes(), columns)
                self._write_numbers(f"p/{name}", relevance[:, block])

    def _write_poses(self, stage: Stage, shown: Shown, moments: Sequence[Moment]) -> None:
        data = stage.task.simulation.data
        places = np.zeros((len(shown), len(moments), 3))
        turns = np.zeros((len(shown), len(moments), 4))  # wxyz
        for step, moment in enumerate(moments):
            stage.show(moment.row)
            for i, (number, _) in enumerate(shown):
                places[i, step] = data.geom_xpos[number]
                mujoco.mju_mat2Quat(turns[i, step], data.geom_xmat[number])
        for i, (_, entity) in enumerate(shown):
            quaternions = np.roll(turns[i], -1, axis=1)
            columns = self._rerun.Transform3D.columns(translation=places[i], quaternion=quaternions)
            self._stream.send_columns(entity, self._indexes(), columns)

    def _write_numbers(self, entity: str, values: Any) -> None:
        """Write a number for each step; steps without one are left out."""
        numbers = np.array(values, dtype=np.float64)
        known = np.isfinite(numbers)
        if known.any():
            columns = self._rerun.Scalars.columns(scalars=numbers[known])
            self._stream.send_columns(entity, self._indexes(known), columns)

    def _write_text(self, step: int, entity: str, text: str) -> None:
        if self._texts.get(entity) != text:
            self._texts[entity] = text
            self._at(step)
            self._stream.log(entity, self._rerun.TextDocument(text))

    def _indexes(self, which: Any = slice(None)) -> list[Any]:
        return [
            self._rerun.TimeColumn(name, **{kind: values[which] for kind, values in line.items()})
            for name, line in self._times.items()
        ]

    def _at(self, step: int) -> None:
        for name, line in self._times.items():
            self._stream.set_time(name, **{kind: values[step] for kind, values in line.items()})


def _relevance(moments: Sequence[Moment]) -> Float64:
    """Return p of each block at each step, [T, N - 1]; NaN where it is not known."""
    hand, count = moments[0].observation.hand_index, len(moments[0].observation.objects)
    found = [one.explanation for one in moments]
    known = [np.full(count, np.nan) if e is None or not len(e.p) else e.p for e in found]
    return np.delete(np.array(known, dtype=np.float64), hand, axis=1)


def _degree(p: float) -> str:
    return "" if np.isnan(p) else f"  p {p:.2f}"


def _shown(model: mujoco.MjModel, blocks: Sequence[str]) -> Shown:
    """Return the geoms that are shown, with the names of their entities."""
    found = []
    for number in range(model.ngeom):
        name = model.geom(number).name
        if name.startswith("block"):
            found.append((number, f"world/blocks/{blocks[int(name.removeprefix('block'))]}"))
        elif name != "floor":
            own = "world/table" if name == "table" else f"world/arm/{name or number}"
            found.append((number, own))
    return found


def _shape(rerun: Any, model: mujoco.MjModel, number: int) -> Any:
    """Return a geom in its own frame, in its color."""
    size, kind = model.geom_size[number], int(model.geom_type[number])
    look: dict[str, Any] = {"colors": [model.geom_rgba[number]], "fill_mode": "solid"}
    if kind == _BOX:
        return rerun.Boxes3D(half_sizes=[size], **look)
    if kind == _SPHERE:
        return rerun.Ellipsoids3D(half_sizes=[[size[0]] * 3], **look)
    if kind == _CAPSULE:  # in Rerun a capsule begins at the origin of its frame
        ends = {"lengths": [2 * size[1]], "translations": [[0.0, 0.0, -size[1]]]}
        return rerun.Capsules3D(radii=[size[0]], **ends, **look)
    return rerun.Cylinders3D(radii=[size[0]], lengths=[2 * size[1]], **look)


def _rerun() -> Any:
    with needs_extra("rerun", "export: --rerun"):
        import rerun
    return rerun
