"""A camera over the table: pictures by OpenGL, and where in them a place is to be found.

The optical frame is ROS's (REP 103): z forward, x right, y down. Pixel (u, v) has its center at
these coordinates, from 0 at the upper left: u = fx x/z + cx, v = fy y/z + cy.
"""

from __future__ import annotations

import copy
import os
import warnings
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pa_ros.arena.errors import RenderError
from pa_ros.arena.simulation import Simulation
from pa_ros.core.body import Body
from pa_ros.core.experience import Float64
from pa_ros.core.settings import Settings

MARK_M, MARK_RGBA = 0.065, (1.0, 1.0, 1.0, 1.0)
LARGEST_PX = 2048
ROOM = 1000  # geoms of a scene
_refusals: list[str] = []  # of OpenGL in this process: none, or one


class CameraConfig(Settings):
    """Pictures of an arena."""

    SECTION: ClassVar[str] = "camera"

    rate_hz: float = Field(
        0.0, ge=0, le=1000, description="pictures per second of simulation time; 0: no camera"
    )
    width: int = Field(320, ge=16, le=LARGEST_PX, description="px")
    height: int = Field(240, ge=16, le=LARGEST_PX, description="px")
    view: Literal["overview", "above"] = Field(
        "overview", description="from a corner of the table, or from above its middle"
    )


def intrinsics(model: mujoco.MjModel, view: str, width: int, height: int) -> Float64:
    """K, [3, 3] px: pixels are square, the axis goes through the picture's middle."""
    focal = height / 2 / np.tan(np.radians(model.camera(view).fovy[0]) / 2)
    middle = (width - 1) / 2, (height - 1) / 2
    return np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])


def optical_pose(model: mujoco.MjModel, view: str) -> Body:
    """Of the optical frame, in the table's. MuJoCo's camera looks along its own -z, y up."""
    camera, turned = model.camera(view), np.zeros(4)
    mujoco.mju_mulQuat(turned, camera.quat, np.array([0.0, 1.0, 0.0, 0.0]))
    return Body.at_rest(camera.pos.copy(), np.roll(turned, -1))


class Camera:
    """Renders what it looked at. All but `look` is for the thread on which it was made."""

    def __init__(
        self, model: mujoco.MjModel, view: str, width: int, height: int, shadows: bool = False
    ) -> None:
        """Models that it looks at later may differ in their blocks.

        MuJoCo renders by what the variable MUJOCO_GL says; where it is not set, by EGL, which needs
        no screen. Raises RenderError if there is no such OpenGL on this machine; then nor is there
        later in this process, for another attempt would make MuJoCo abort it.
        """
        if _refusals:
            raise RenderError(_refusals[0])
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._scene = mujoco.MjvScene(model, ROOM)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = shadows
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(view).id
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # GLFW's, on a machine without a display
                self._gl: Any = _context(width, height)
            self._gl.make_current()
            self._buffer = mujoco.MjrContext(_of_this_size(model, width, height, shadows), 100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._buffer)
        except Exception as error:  # each OpenGL back end has its own kinds of failure
            _refusals.append(
                "expected offscreen OpenGL (MUJOCO_GL=egl or osmesa), got "
                f"{type(error).__name__}: {error}"
            )
            raise RenderError(_refusals[0]) from error

    def look(self, simulation: Simulation, marked: Sequence[int] = ()) -> None:
        """Take in the present moment; a ring lies on the table around each object that is
        `marked`. On the simulation's thread, while no picture is being made."""
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        known = simulation.model, simulation.data, self._option, None, self._camera, every
        mujoco.mjv_updateScene(*known, self._scene)
        for index in marked:
            _mark(self._scene, simulation.positions[index])

    def picture(self) -> NDArray[np.uint8]:
        """Of what it looked at last: RGB, [height, width, 3]."""
        upside_down = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        mujoco.mjr_render(self._rect, self._scene, self._buffer)
        mujoco.mjr_readPixels(upside_down, None, self._rect, self._buffer)
        return upside_down[::-1].copy()

    def close(self) -> None:
        """Give back what OpenGL holds."""
        self._buffer.free()
        self._gl.free()


def _context(width: int, height: int) -> Any:
    """What makes OpenGL draw into memory."""
    if os.environ.get("MUJOCO_GL"):
        return mujoco.GLContext(width, height)
    from mujoco.egl import GLContext

    return GLContext(width, height)


def _of_this_size(model: mujoco.MjModel, width: int, height: int, shadows: bool) -> mujoco.MjModel:
    """The same, asking for memory for no more than such a picture."""
    model = copy.copy(model)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    if not shadows:
        model.vis.quality.shadowsize = 0
    return model


def _mark(scene: mujoco.MjvScene, place: Float64) -> None:
    """A bright disk on the table under a block, larger than it; dropped where the scene is full."""
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
