"""The reaching task seen by a camera: what agents observe of blocks is what pictures show.

Privileged, as in the paper: the verifier, which scores the true state.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pa_ros.arena import ArenaConfig, Design, Episode, ReachTask, training_programs, world_of
from pa_ros.arena.camera import PLAIN, Pictures
from pa_ros.core.experience import Float32, Float64, Observation, Verdict
from pa_ros.perception.blobs import Blob, blobs
from pa_ros.perception.calibration import MOST, Calibration, Cameras
from pa_ros.perception.sight import Sight
from pa_ros.perception.view import Picture, View
from pa_ros.world import Reward
from pa_ros.world.measures import ProgramMeasures
from pa_ros.world.poses import POSE_WIDTH
from pa_ros.world.world import World

CALIBRATION_SEED = 3_000_003  # of scenes that neither training nor evaluation sees
SCENES = 100
LOOK_EVERY = 10  # steps between pictures, while something may be hidden
# Where the arm touches blocks: a hand so high touches none, and then steps between pictures.
LIFTED_M, LIFTED_EVERY = 0.15, 3


class CameraTask(ReachTask):
    """`ReachTask`, observed through a camera.

    Verdicts say the measure of every training program, for learners whose observations do not tell
    which words are true.
    """

    def __init__(
        self,
        config: ArenaConfig,
        design: Design,
        seed: int,
        cameras: Cameras,
        reward: Reward | None = None,
        pictures: Pictures = PLAIN,
    ) -> None:
        """RenderError where there is no OpenGL, ConfigError for a design that is not seen."""
        self.seen_schema = cameras.schema(design.schema)
        super().__init__(config, design, seed, reward)
        true = world_of(config, design)
        self._measures = ProgramMeasures(training_programs(design), true, self.scoring)
        self._scene: Episode | None = None  # whose blocks the programs name as `_named` says
        self.sight = Sight(config, cameras, pictures, self.seen_schema)
        self._looked_at = 0  # step of the newest picture

    @property
    def world(self) -> World:
        """The facts that agents and learners of this task must agree on."""
        return replace(super().world, schema=self.seen_schema)

    def reset_to(self, episode: Episode) -> tuple[Observation, Verdict]:
        self.sight.begin()
        return super().reset_to(episode)

    def rearrange(self, episode: Episode, poses: Float64, twists: Float64) -> None:
        super().rearrange(episode, poses, twists)
        self.sight.begin()

    def close(self) -> None:
        self.sight.close()

    def drawn(self) -> Picture:
        """The current picture of each camera, with the objects found so far (`Sight.drawn`)."""
        return self.sight.drawn(self.pictures())

    def pictures(self) -> list[Picture]:
        """The current picture of each camera."""
        state = self.simulation.model, self.simulation.data
        return [view.take(*state) for view in self.sight.views]

    def _observe(self) -> tuple[Observation, Verdict]:
        true, verdict = super()._observe()
        if not self.sight.looked or self._is_due(float(true.hand_pose[2])):
            self._looked_at = self._step
            self.sight.look(self.pictures(), true.joint_position)
        objects = self.sight.objects(true.hand_pose, self._told(true.objects))
        if self._scene is not self.episode:
            self._scene = self.episode
            self._named = self._measures.named(true.objects, true.hand_index)
        measures = self._measures(self._named, true.objects, true.hand_pose).tolist()
        return replace(true, objects=objects), replace(verdict, measures=tuple(measures))

    def _told(self, objects: Float32) -> Float32:
        """The rows of objects without a body, [told, F]; `objects` [N, F] are the true
        ones."""
        told = []
        for block, row in zip(self.episode.blocks, objects[1:], strict=True):
            if not self.seen_schema.has_body(block.kind):
                told.append(self.seen_schema.features(block.kind))
                told[-1][:POSE_WIDTH] = row[:POSE_WIDTH]
        return np.array(told, np.float32).reshape(-1, self.seen_schema.width)

    def _is_due(self, hand_height: float) -> bool:
        """Whether this step needs a picture; another program at the same step needs no second."""
        if self._step == self._looked_at:
            return False
        if self.config.arm_touches_blocks:
            return hand_height < LIFTED_M or self._step % LIFTED_EVERY == 0
        return self._step % LOOK_EVERY == 0 and not self.sight.complete


def calibrate(
    config: ArenaConfig, design: Design, view: str, px: int, enough: int = MOST
) -> Calibration:
    """Look at training scenes until `enough` blobs were seen. RenderError where there is no OpenGL,
    PerceptionError for a camera that sees no blocks."""
    task, camera = ReachTask(config, design, CALIBRATION_SEED), View(config, view, px, px)
    found: list[Blob] = []
    try:
        for index in range(SCENES):
            seen, _ = task.reset(index)
            picture = camera.take(task.simulation.model, task.simulation.data)
            every = blobs(camera, picture, camera.arm(seen.joint_position))
            found += [blob for blob in every if not blob.covered]
            if len(found) >= enough:
                break
    finally:
        camera.close()
    return Calibration.of(view, (px, px), found)
