"""What a camera sees of the table: pictures to object features, without ROS (NumPy, OpenCV).

`Sight` does it all: the camera's `View`, `blobs` in a picture, a `Tracker`, and a `Calibration` of
what blobs look like. `CameraTask` is the arena seen by it. This module needs no OpenCV.
"""

from __future__ import annotations

from pa_ros.arena import ArenaConfig, Design, ReachTask
from pa_ros.perception.errors import PerceptionError
from pa_ros.world import Reward

VIEWS = {"camera": "above", "corner": "overview"}
"""Cameras that agents can see through, by the name of the option, and the arena's name for them."""
SIDE_PX = 240  # of their square pictures


def calibrated(config: ArenaConfig, design: Design, perception: str) -> str:
    """Calibrate one of VIEWS by looking at training scenes: the text for `task_seen`.

    Raises PerceptionError without OpenCV, RenderError without OpenGL.
    """
    try:
        from pa_ros.perception.task import calibrate
    except ImportError as error:
        raise _without_opencv(error) from error
    return calibrate(config, design, VIEWS[perception], SIDE_PX).to_text()


def task_seen(
    config: ArenaConfig, design: Design, seed: int, calibration: str, reward: Reward | None = None
) -> ReachTask:
    """The task through a calibrated camera; an empty text: properties are told.

    Raises PerceptionError without OpenCV or for another text, RenderError without OpenGL.
    """
    if not calibration:
        return ReachTask(config, design, seed, reward)
    try:
        from pa_ros.perception.calibration import Calibration
        from pa_ros.perception.task import CameraTask
    except ImportError as error:
        raise _without_opencv(error) from error
    return CameraTask(config, design, seed, Calibration.from_text(calibration), reward)


def _without_opencv(error: ImportError) -> PerceptionError:
    return PerceptionError(
        f"perception: expected OpenCV (pip install 'programmable-agents[camera]'), got: {error}",
        code="perception.missing",
    )
