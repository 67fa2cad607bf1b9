"""Films of recorded episodes, drawn from the recorded joints and objects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.appearance import Look
from pa_ros.arena.designs import Design, Kind
from pa_ros.arena.episodes import Block, Episode
from pa_ros.arena.movie import Picture, captioned, check_movie, write_movie
from pa_ros.arena.render import draw
from pa_ros.bags.episodes import RecordedEpisode, Row
from pa_ros.bags.errors import BagError
from pa_ros.core.experience import Float32, Float64
from pa_ros.language import parse, parse_goal, stages
from pa_ros.language.errors import ProgramError
from pa_ros.language.syntax import SIZE
from pa_ros.wire.arena import ArenaDescription
from pa_ros.world.relation import at_stage, measured
from pa_ros.world.schema import MIDDLE_EDGE_M, ObjectSchema


class RecordedScene:
    """Shows recorded states. Nothing is simulated."""

    def __init__(self, episode: RecordedEpisode, arena: ArenaDescription) -> None:
        """Raises BagError if a row lacks the joints' positions."""
        if not episode.rows or not len(episode.rows[0].joint_position):
            raise BagError(f"film: episode {episode.number}: its joint positions are not recorded")
        config = preset_named(arena.preset, arena.arm).changed(episode_steps=arena.episode_steps)
        design = design_named(arena.design).with_relations(*arena.world.relations)
        self.task = ReachTask(config, design, arena.seed)
        self._shown: tuple[str, int] | None = None  # the recorded program in force, its stage
        self._schema = arena.world.schema
        self._vocabulary, self._number = self.task.design.vocabulary, episode.number
        self._furnish(episode.rows[0], episode.rows[0].joint_position)

    def _furnish(self, row: Row, arm: Float64) -> None:
        """Set up a row's blocks, with no recorded program in force yet."""
        blocks = tuple(
            _block(features, self._schema, self.task.design)
            for i, features in enumerate(row.objects)
            if i != row.hand_index
        )
        word, start = self._vocabulary.words[0], tuple(arm.tolist())
        anything = f"{self._vocabulary.relations[0]}(HAND, OR({word}, NOT({word})))"
        program = parse(anything, self._vocabulary)
        self.task.reset_to(Episode(self._number, "train", blocks, start, program))
        self._looks, self._shown = row.looks, None
        self._all_known = not any(isinstance(block, _SeenBlock) for block in blocks)

    def show(self, row: Row) -> None:
        """Put arm and blocks where a row says."""
        if row.looks != self._looks:
            self._furnish(row, self.task.simulation.joint_position)
        data, model = self.task.simulation.data, self.task.simulation.model
        joints = self.task.config.joints
        if len(row.joint_position):
            data.qpos[:joints] = row.joint_position
        mujoco.mj_kinematics(model, data)
        hand = model.body("hand").id
        rotation, origin = data.xmat[hand].reshape(3, 3), data.xpos[hand]
        blocks = np.delete(row.objects.astype(np.float64), row.hand_index, axis=0)
        for i, block in enumerate(blocks):
            turn = np.zeros(4)
            mujoco.mju_mulQuat(turn, data.xquat[hand], np.roll(block[3:7], 1))
            self.task.simulation.put(i, origin + rotation @ block[:3], turn)
        mujoco.mj_kinematics(model, data)
        if (row.program, row.stage) != self._shown or self.task.program.compares:
            self._shown = row.program, row.stage
            try:
                pursued = stages(parse_goal(row.program, self._vocabulary))[row.stage]
                self.task.set_program(pursued)
                named = self._all_known
            except (ProgramError, IndexError):  # no program is in force, or its text is unrecorded
                named = False
            if not named:
                self.task.verifier.moved = self.task.verifier.targets = ()


class _SeenBlock(Block):
    """A block whose properties nobody knows, in grey."""

    @property
    def look(self) -> Look:
        return Look()


def film(
    episode: RecordedEpisode, arena: ArenaDescription, path: Path, rendered: bool, side_px: int
) -> int:
    """Write a WebP, GIF or MP4 at the speed of the arena. Returns its number of pictures.

    `rendered`: in perspective instead of from above. Raises RenderError without OpenGL.
    """
    check_movie(path)
    pictures = _pictures(episode, RecordedScene(episode, arena), rendered, side_px)
    return write_movie(path, pictures, arena.control_period)


def _pictures(
    episode: RecordedEpisode, scene: RecordedScene, rendered: bool, side_px: int
) -> Iterator[Picture]:
    for row in episode.rows:
        scene.show(row)
        yield captioned(draw(scene.task, side_px, rendered), _caption(row))


def _caption(row: Row) -> tuple[str, str]:
    """Return the program, and the step with its reward and distance where these are recorded."""
    parts = [f"step {row.step}"]
    if np.isfinite(row.reward):
        parts.append(f"reward {row.reward:+.2f}")
    if np.isfinite(row.distance):
        parts.append(f"distance {measured(row.program, row.distance, row.stage)}")
    if stage := at_stage(row.program, row.stage):
        parts.append(stage)
    return row.program or "no program", "   ".join(parts)


def _block(features: Float32, schema: ObjectSchema, design: Design) -> Block:
    """Return a recorded object as a block, without its pose."""
    has = dict(zip(schema.slices, schema.has(features), strict=True))
    if not all(has[group].any() for group in design.values):
        return _SeenBlock(design.train[0], 0.0, 0.0, 0.0)
    values = {g: schema[g].features.values[int(has[g].argmax())] for g in design.values}
    edge_m = 0.0
    if design.edges_m:
        edge_m = MIDDLE_EDGE_M + float(features[design.schema.slices[SIZE].start])
    return Block(Kind(**values), 0.0, 0.0, 0.0, edge_m)
