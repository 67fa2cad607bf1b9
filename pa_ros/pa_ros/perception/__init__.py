"""Perception: object features from pictures of the table, without ROS (NumPy, OpenCV).

`Sight` does it all: the camera's `View`, `blobs` in a picture, a `Tracker`, and a `Calibration` of
what blobs look like. `CameraTask` is the arena seen by it. This module needs no OpenCV.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pa_ros.arena import ArenaConfig, Design, ReachTask
from pa_ros.arena.camera import PLAIN, Pictures
from pa_ros.perception.errors import PerceptionError
from pa_ros.world import Reward

if TYPE_CHECKING:
    from pa_ros.perception.sight import Sight

TOLD = "told"
VIEWS = {"camera": ["above"], "corner": ["overview"], "both": ["above", "overview"]}
"""The arena's cameras that agents can see through, by the name of the option."""
SIDE_PX = 240  # of their square pictures


def calibrated(config: ArenaConfig, design: Design, perception: str) -> str:
    """Calibrate one of VIEWS by looking at training scenes: the text for `task_seen`; "" for TOLD.

    Raises PerceptionError without OpenCV, RenderError without OpenGL.
    """
    if perception == TOLD:
        return ""
    with _opencv():
        from pa_ros.perception.calibration import Cameras
        from pa_ros.perception.task import calibrate
    found = [calibrate(config, design, view, SIDE_PX) for view in VIEWS[perception]]
    return Cameras(tuple(found)).to_text()


def task_seen(
    config: ArenaConfig,
    design: Design,
    seed: int,
    calibration: str,
    reward: Reward | None = None,
    pictures: Pictures = PLAIN,
) -> ReachTask:
    """The task through a calibrated camera; an empty text: properties are told.

    Raises PerceptionError without OpenCV or for another text, RenderError without OpenGL.
    """
    if not calibration:
        return ReachTask(config, design, seed, reward)
    with _opencv():
        from pa_ros.perception.calibration import Cameras
        from pa_ros.perception.task import CameraTask
    return CameraTask(config, design, seed, Cameras.from_text(calibration), reward, pictures)


def sight_of(config: ArenaConfig, calibration: str) -> Sight:
    """The `Sight` of a calibrated camera, in whose pictures objects may be seen that are not there,
    over an arm's table. Raises as `task_seen`."""
    with _opencv():
        from pa_ros.perception.calibration import Cameras
        from pa_ros.perception.sight import Sight
    return Sight(config, Cameras.from_text(calibration), rendered=False)


@contextmanager
def _opencv() -> Iterator[None]:
    """Translate a failed import of OpenCV."""
    try:
        yield
    except ImportError as error:
        raise PerceptionError(
            "perception: expected OpenCV (pip install 'programmable-agents[camera]'), got: "
            f"{error}",
            code="perception.missing",
        ) from error
