"""One camera over the table: where a pixel's ray meets the table, and how the arm looks to it.

The arm's own model is rendered at the measured joint angles, so that what is seen of it is not
taken for an object. Privileged information about blocks is not used.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pa_ros.arena.camera import PLAIN, Camera, Pictures, intrinsics, optical_pose
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.model import TABLE_SIDE_M, build, build_textured
from pa_ros.core.experience import Float64
from pa_ros.perception.errors import PerceptionError

Picture = NDArray[np.uint8]  # RGB, [height, width, 3]
Mask = NDArray[np.bool_]  # [height, width]

BLOCK_M = 0.06  # side of a usual block, the unit of areas
PLANE_M = 0.03  # height at which the middle of what is seen is taken to be
MARGIN_M = 0.01  # at the table's edge
OF_ARM = 8  # least difference of a color (0 to 255) that shows the arm's model


class View:
    """A calibrated camera: its matrix, its pose, the empty table, and the arm's model."""

    def __init__(
        self, config: ArenaConfig, view: str, width: int, height: int, pictures: Pictures = PLAIN
    ) -> None:
        """`view` is a camera of the arena. The empty table is known with its texture, but in plain
        light. RenderError where there is no OpenGL."""
        self.width, self.height = width, height
        self._model = build_textured(config) if pictures.texture else build(config, [])
        self._data = mujoco.MjData(self._model)
        self._joints = config.joints
        known, size = Pictures(texture=pictures.texture), (width, height)

        def camera(of: Pictures) -> Camera:
            # Places are marks whose poses are given as numbers; cameras do not see them.
            return Camera(self._model, view, *size, of, shows_places=False)

        self._imagined = camera(known)
        self._camera = self._imagined if pictures == known else camera(pictures)
        self.matrix = intrinsics(self._model, view, width, height)  # K, [3, 3] px
        pose, turn = optical_pose(self._model, view), np.zeros(9)
        mujoco.mju_quat2Mat(turn, np.roll(pose.quaternion, 1))
        self._place, self._turn = pose.position, turn.reshape(3, 3)  # columns: optical axes
        self.empty = self._empty_table()
        v, u = np.mgrid[:height, :width]
        x, y = np.moveaxis(self.on_plane(u, v, 0.0), -1, 0)
        reach = TABLE_SIDE_M / 2 - MARGIN_M
        with np.errstate(invalid="ignore"):  # a ray above the horizon meets no table
            self.table: Mask = (abs(x) < reach) & (abs(y) < reach)

    def close(self) -> None:
        """Free the resources of OpenGL."""
        self._camera.close()
        if self._imagined is not self._camera:
            self._imagined.close()

    def check(self, picture: Picture) -> None:
        """Raise PerceptionError unless a picture has this camera's size."""
        if picture.shape != self.empty.shape:
            raise PerceptionError(
                f"picture: expected RGB of {self.width} x {self.height} px, as calibrated, got "
                f"shape {picture.shape}",
                code="perception.picture",
            )

    def arm(self, joint_position: Float64) -> Mask:
        """The pixels that show the arm at these joint positions (rad)."""
        self._data.qpos[: self._joints] = joint_position
        shown = self._imagine().astype(np.int16)
        arm: Mask = largest(np.abs(shown - self.empty)) > OF_ARM
        return arm

    @property
    def hand(self) -> Float64:
        """Where the hand of the arm's model is, [3] m."""
        return np.asarray(self._data.body("hand").xpos)

    def on_plane(self, u: Any, v: Any, height: float) -> Float64:
        """Where the rays of pixels meet the plane at a height: x y, [..., 2] m; NaN: nowhere."""
        (fx, _, cx), (_, fy, cy) = self.matrix[:2]
        ray = np.stack(np.broadcast_arrays((u - cx) / fx, (v - cy) / fy, 1.0), -1) @ self._turn.T
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (height - self._place[2]) / ray[..., 2]
        along = np.where(along > 0, along, np.nan)
        met: Float64 = self._place[:2] + along[..., None] * ray[..., :2]
        return met

    def pixels(self, xy: Float64, height: float) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """The columns and rows of the pixels, also outside the picture, that show places [..., 2]
        at a height."""
        places = np.concatenate([xy, np.full((*xy.shape[:-1], 1), height)], -1)
        x, y, along = np.moveaxis((places - self._place) @ self._turn, -1, 0)
        (fx, _, cx), (_, fy, cy) = self.matrix[:2]
        return np.rint(fx * x / along + cx).astype(int), np.rint(fy * y / along + cy).astype(int)

    def shows(self, mask: Mask, xy: Float64) -> bool:
        """Whether a mask is true where the middle of a block at `xy` is seen."""
        column, row = self.pixels(xy, PLANE_M)
        return bool(mask[row.clip(0, self.height - 1), column.clip(0, self.width - 1)])

    def pixels_per_m(self, xy: Float64) -> float:
        """How large a metre at a place on the table is in the picture."""
        away = np.array([*xy, PLANE_M]) - self._place
        return float(self.matrix[0, 0] / (away @ self._turn[:, 2]))

    def take(self, model: mujoco.MjModel, data: mujoco.MjData) -> Picture:
        """A picture of any state of this arena."""
        return _taken(self._camera, model, data)

    def _imagine(self) -> Picture:
        """A picture of the arm's model, in plain light."""
        return _taken(self._imagined, self._model, self._data)

    def _empty_table(self) -> NDArray[np.int16]:
        """The picture without arm and blocks."""
        alpha = self._model.geom_rgba[:, 3].copy()
        for i in range(self._model.ngeom):
            if self._model.geom(i).name not in ("floor", "table"):
                self._model.geom_rgba[i, 3] = 0.0
        empty = self._imagine().astype(np.int16)
        self._model.geom_rgba[:, 3] = alpha
        return empty


def total(colors: NDArray[Any]) -> NDArray[Any]:
    """The sum over red, green and blue, [..., 3]: far sooner than by a reduction."""
    return np.asarray(colors[..., 0] + colors[..., 1] + colors[..., 2])


def largest(colors: NDArray[Any]) -> NDArray[Any]:
    """The largest of red, green and blue, [..., 3]."""
    return np.asarray(np.maximum(np.maximum(colors[..., 0], colors[..., 1]), colors[..., 2]))


def _taken(camera: Camera, model: mujoco.MjModel, data: mujoco.MjData) -> Picture:
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    return camera.of(model, data)
