"""The reaching task seen by a camera: what agents observe of blocks is what pictures show.

Privileged, as in the paper: the verifier, which scores the true state.
"""

from __future__ import annotations

from dataclasses import replace

from pa_ros.arena import ArenaConfig, Design, Episode, ReachTask
from pa_ros.arena.camera import PLAIN, Pictures
from pa_ros.core.experience import Float64, Observation, Verdict
from pa_ros.perception.blobs import Blob, blobs
from pa_ros.perception.calibration import MOST, Calibration, Cameras
from pa_ros.perception.sight import Sight
from pa_ros.perception.view import Picture, View
from pa_ros.world import Reward
from pa_ros.world.world import World

CALIBRATION_SEED = 3_000_003  # of scenes that neither training nor evaluation sees
SCENES = 100
LOOK_EVERY = 10  # steps between pictures, while something may be hidden


class CameraTask(ReachTask):
    """`ReachTask`, observed through a camera."""

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
        super().__init__(config, design, seed, reward, measures_programs=True)
        self.sight = Sight(config, cameras, pictures)
        # Blocks that the arm touches may move, so every step is looked at.
        self._every = 1 if config.arm_touches_blocks else LOOK_EVERY
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
        if not self.sight.looked or self._is_due():
            self._looked_at = self._step
            self.sight.look(self.pictures(), true.joint_position)
        return replace(true, objects=self.sight.objects(true.hand_pose)), verdict

    def _is_due(self) -> bool:
        """Whether this step needs a picture; another program at the same step needs no second."""
        if self._step % self._every or self._step == self._looked_at:
            return False
        return self._every == 1 or not self.sight.complete


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
