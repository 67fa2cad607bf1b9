"""A camera over the table: pictures by OpenGL, and the pixel at which a place is seen.

The optical frame is that of ROS (REP 103): z forward, x right, y down. A place is seen at pixel
u = fx x/z + cx, v = fy y/z + cy; (0, 0) is the center of the upper left pixel.
"""

from __future__ import annotations

import copy
import os
import warnings
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pa_ros.arena.errors import RenderError
from pa_ros.arena.model import PLACES
from pa_ros.arena.simulation import Simulation
from pa_ros.core.experience import Body, Float64
from pa_ros.core.settings import Settings

CLOSE = "close"  # a view for films: the middle of the table fills the picture
MARK_M, MARK_RGBA = 0.065, (1.0, 1.0, 1.0, 1.0)
LARGEST_PX = 2048
MAX_GEOMS = 1000  # of a scene
ASIDE = (0.9, -0.6)  # m; from there the arm's shadow is seen from above
_failures: list[str] = []  # the message of a failed attempt to use OpenGL, if any


class CameraConfig(Settings):
    """Settings of the pictures of an arena."""

    SECTION: ClassVar[str] = "camera"

    rate_hz: float = Field(
        0.0, ge=0, le=1000, description="pictures per second of simulation time; 0: no camera"
    )
    width: int = Field(320, ge=16, le=LARGEST_PX, description="px")
    height: int = Field(240, ge=16, le=LARGEST_PX, description="px")
    view: Literal["overview", "above"] = Field(
        "overview", description="from a corner of the table, or from above its middle"
    )


@dataclass(frozen=True)
class Pictures:
    """How the world looks to a camera; it changes nothing else."""

    light: float = 1.0  # factor of all lights
    noise: float = 0.0  # standard deviation of each number of a pixel, 0 to 255
    shadows: bool = False
    lamp: tuple[float, float] = (0.0, 0.0)  # m from its usual place above the table's middle
    texture: bool = False  # of the table, if the model has one (`model.build_textured`)


PICTURES = {
    "plain": Pictures(),
    "dim": Pictures(light=0.7),
    "bright": Pictures(light=1.3),
    "noise": Pictures(noise=10.0),
    "shadows": Pictures(shadows=True, lamp=ASIDE),
    "texture": Pictures(texture=True),
    "hard": Pictures(light=0.7, noise=10.0, shadows=True, lamp=ASIDE, texture=True),
}
PLAIN = PICTURES["plain"]


def intrinsics(model: mujoco.MjModel, view: str, width: int, height: int) -> Float64:
    """The matrix K, [3, 3] px; pixels are square, the optical axis is in the middle."""
    focal = height / 2 / np.tan(np.radians(model.camera(view).fovy[0]) / 2)
    middle = (width - 1) / 2, (height - 1) / 2
    return np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])


def optical_pose(model: mujoco.MjModel, view: str) -> Body:
    """Pose of the optical frame in the table's. MuJoCo's camera looks along its own -z, y up."""
    camera, turned = model.camera(view), np.zeros(4)
    mujoco.mju_mulQuat(turned, camera.quat, np.array([0.0, 1.0, 0.0, 0.0]))
    return Body.at_rest(camera.pos.copy(), np.roll(turned, -1))


class Camera:
    """Renders pictures. Call all methods but `look` on the thread that made the camera."""

    def __init__(
        self,
        model: mujoco.MjModel,
        view: str,
        width: int,
        height: int,
        pictures: Pictures = PLAIN,
        shows_places: bool = True,
    ) -> None:
        """`view` is a camera of the model, or CLOSE. Later models may have other blocks.

        The environment variable MUJOCO_GL chooses the OpenGL of MuJoCo; the default is EGL, which
        needs no screen. Raises RenderError if this machine does not have it.
        """
        # MuJoCo aborts the process at a second attempt, so the first failure is final.
        if _failures:
            raise RenderError(_failures[0])
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(model, MAX_GEOMS)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = pictures.shadows
        self._pictures, self._random = pictures, np.random.default_rng(0)
        self._textured: int | None = model.geom("table").id if pictures.texture else None
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._option.geomgroup[PLACES] = shows_places
        self._close = view == CLOSE
        if self._close:
            self._camera.lookat[:] = 0.0, 0.0, 0.06
            self._camera.distance, self._camera.azimuth, self._camera.elevation = 1.45, 150, -52
        else:
            self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._camera.fixedcamid = model.camera(view).id
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # from GLFW, on a machine without a display
                self._gl: Any = _context(width, height)
            self._gl.make_current()
            sized = _of_this_size(model, width, height, pictures.shadows)
            self._buffer = mujoco.MjrContext(sized, 100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._buffer)
            # Without this, a camera that nobody closed would free what another one uses.
            self._finalizer = weakref.finalize(self, _free, self._gl, self._buffer)
            self._finalizer.atexit = False
        except Exception as error:  # each OpenGL back end raises its own errors
            _failures.append(
                "expected offscreen OpenGL (MUJOCO_GL=egl or osmesa), got "
                f"{type(error).__name__}: {error}"
            )
            raise RenderError(_failures[0]) from error

    def look(self, simulation: Simulation, marked: Sequence[int] = ()) -> None:
        """Copy the current scene, with a ring on the table around each `marked` object. Call it on
        the simulation's thread, and not while a picture is being made."""
        self._update(simulation.model, simulation.data)
        if self._close:
            _brighten(self._scene)
        for index in marked:
            _mark(self._scene, simulation.positions[index])

    def picture(self) -> NDArray[np.uint8]:
        """A picture of the last scene: RGB, [height, width, 3]."""
        # OpenGL's first row is the lowest one.
        upside_down = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._buffer)
        mujoco.mjr_readPixels(upside_down, None, self._rect, self._buffer)
        picture = upside_down[::-1].copy()
        if self._pictures.noise:
            noise = self._random.normal(0.0, self._pictures.noise, picture.shape)
            picture = np.clip(picture + noise, 0, 255).astype(np.uint8)
        return picture

    def of(self, model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.uint8]:
        """A picture of any state, at once. Other cameras may be used between two pictures."""
        self._update(model, data)
        return self.picture()

    def _update(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, every, self._scene)
        if self._pictures.light != 1.0:
            for light in self._scene.lights[: self._scene.nlight]:
                for part in (light.ambient, light.diffuse, light.specular):
                    part *= self._pictures.light
        if any(self._pictures.lamp):
            for light in self._scene.lights[: self._scene.nlight]:
                if not light.headlight:
                    light.pos[:2] += self._pictures.lamp
                    light.dir[:] = -light.pos / np.linalg.norm(light.pos)
        if self._textured is not None:
            for geom in self._scene.geoms[: self._scene.ngeom]:
                if geom.objid == self._textured and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                    geom.matid = 0

    def close(self) -> None:
        """Free the resources of OpenGL."""
        self._finalizer()


def _free(context: Any, buffer: mujoco.MjrContext) -> None:
    context.make_current()
    buffer.free()
    context.free()


def _context(width: int, height: int) -> Any:
    """An OpenGL context that draws into memory."""
    if os.environ.get("MUJOCO_GL"):
        return mujoco.GLContext(width, height)
    from mujoco.egl import GLContext

    return GLContext(width, height)


def _of_this_size(model: mujoco.MjModel, width: int, height: int, shadows: bool) -> mujoco.MjModel:
    """A copy of the model whose buffers fit a picture of this size."""
    # Buffers of the model's default size would need memory for far larger pictures.
    model = copy.copy(model)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    # The usual map of shadows, 4096 px, would take most of the time of a small picture.
    usual, enough = model.vis.quality.shadowsize, 4 * max(width, height)
    model.vis.quality.shadowsize = min(usual, enough) if shadows else 0
    return model


def _brighten(scene: mujoco.MjvScene) -> None:
    """Light the scene evenly, in front of a light background without an end."""
    for light in scene.lights[: scene.nlight]:
        light.ambient[:], light.diffuse[:] = (0.42, 0.3) if light.headlight else (0.1, 0.5)
        light.specular[:] = 0.1
    for geom in scene.geoms[: scene.ngeom]:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            geom.rgba[:], geom.size[:], geom.reflectance = (0.92, 0.93, 0.95, 1.0), 0.0, 0.0


def _mark(scene: mujoco.MjvScene, place: Float64) -> None:
    """Add a bright disk on the table under a block, unless the scene is full."""
    if scene.ngeom < scene.maxgeom:
        mujoco.mjv_initGeom(
            scene.geoms[scene.ngeom],
            mujoco.mjtGeom.mjGEOM_CYLINDER,
            np.array([MARK_M, 0.001, 0.0]),
            np.array([place[0], place[1], 0.002]),
            np.eye(3).ravel(),
            np.array(MARK_RGBA, dtype=np.float32),
        )
        scene.ngeom += 1
