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
from pa_ros.core.experience import Float32, Float64, Observation, Step
from pa_ros.language import parse, parse_goal, stages
from pa_ros.language.errors import ProgramError
from pa_ros.language.syntax import SIZE
from pa_ros.wire.arena import ArenaDescription
from pa_ros.world.relation import at_stage, measured
from pa_ros.world.schema import MIDDLE_EDGE_M, POSE, ObjectSchema


class RecordedScene:
    """Shows recorded states. Nothing is simulated."""

    def __init__(self, arena: ArenaDescription, step: Step) -> None:
        """The scene of one of the arena's steps."""
        config = preset_named(arena.preset, arena.arm).changed(episode_steps=arena.episode_steps)
        design = design_named(arena.design).with_relations(*arena.world.relations)
        self.task = ReachTask(config, design, arena.seed)
        self._shown: tuple[str, int] | None = None  # the recorded program in force, its stage
        self._schema = arena.world.schema
        self._vocabulary = self.task.design.vocabulary
        self._furnish(step.observation, step.observation.joint_position)

    def _furnish(self, seen: Observation, arm: Float64) -> None:
        """Set up an observation's blocks, with no recorded program in force yet."""
        blocks = tuple(
            _block(features, self._schema, self.task.design)
            for i, features in enumerate(seen.objects)
            if i != seen.hand_index
        )
        word, start = self._vocabulary.words[0], tuple(arm.tolist())
        anything = f"{self._vocabulary.relations[0]}(HAND, OR({word}, NOT({word})))"
        program = parse(anything, self._vocabulary)
        self.task.reset_to(Episode(seen.episode, "train", blocks, start, program))
        self._looks, self._shown = looks(seen), None
        self._all_known = not any(isinstance(block, _SeenBlock) for block in blocks)

    def show(self, step: Step) -> None:
        """Put arm and blocks where a step says."""
        seen = step.observation
        if looks(seen) != self._looks:
            self._furnish(seen, self.task.simulation.joint_position)
        data, model = self.task.simulation.data, self.task.simulation.model
        joints = self.task.config.joints
        data.qpos[:joints] = seen.joint_position
        mujoco.mj_kinematics(model, data)
        hand = model.body("hand").id
        rotation, origin = data.xmat[hand].reshape(3, 3), data.xpos[hand]
        blocks = np.delete(seen.objects.astype(np.float64), seen.hand_index, axis=0)
        for i, block in enumerate(blocks):
            turn = np.zeros(4)
            mujoco.mju_mulQuat(turn, data.xquat[hand], np.roll(block[3:7], 1))
            self.task.simulation.put(i, origin + rotation @ block[:3], turn)
        mujoco.mj_kinematics(model, data)
        if (step.program, step.stage) != self._shown or self.task.program.compares:
            self._shown = step.program, step.stage
            try:
                pursued = stages(parse_goal(step.program, self._vocabulary))[step.stage]
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


def looks(seen: Observation) -> bytes:
    """The objects' features without their poses: equal for scenes of the same objects."""
    return np.ascontiguousarray(seen.objects[:, len(POSE) :]).tobytes()


def film(
    episode: RecordedEpisode,
    arena: ArenaDescription,
    path: Path,
    rendered: bool | None,
    side_px: int,
) -> int:
    """Write a WebP, GIF or MP4 at the speed of the arena. Returns its number of pictures.

    `rendered` is as in `draw`. Raises RenderError if it is true and there is no OpenGL.
    """
    check_movie(path)
    scene = RecordedScene(arena, episode.rows[0].step)
    pictures = _pictures(episode, scene, rendered, side_px)
    return write_movie(path, pictures, arena.control_period)


def _pictures(
    episode: RecordedEpisode, scene: RecordedScene, rendered: bool | None, side_px: int
) -> Iterator[Picture]:
    for row in episode.rows:
        scene.show(row.step)
        yield captioned(draw(scene.task, side_px, rendered), _caption(row))


def _caption(row: Row) -> tuple[str, str]:
    """The program, and the step with its reward and distance where these are recorded."""
    step, parts = row.step, [f"step {row.seen.step}"]
    if np.isfinite(row.reward):
        parts.append(f"reward {row.reward:+.2f}")
    if np.isfinite(row.distance):
        parts.append(f"distance {measured(step.program, row.distance, step.stage)}")
    if stage := at_stage(step.program, step.stage):
        parts.append(stage)
    return step.program or "no program", "   ".join(parts)


def _block(features: Float32, schema: ObjectSchema, design: Design) -> Block:
    """A recorded object as a block, without its pose."""
    has = dict(zip(schema.slices, schema.has(features), strict=True))
    if not all(has[group].any() for group in design.values):
        return _SeenBlock(design.train[0], 0.0, 0.0, 0.0)
    values = {g: schema[g].features.values[int(has[g].argmax())] for g in design.values}
    edge_m = 0.0
    if design.edges_m:
        edge_m = MIDDLE_EDGE_M + float(features[design.schema.slices[SIZE].start])
    return Block(Kind(**values), 0.0, 0.0, 0.0, edge_m)
