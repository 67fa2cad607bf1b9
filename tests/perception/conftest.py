"""One calibration for all tests that see."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from helpers.pictures import opengl
from pa_ros.arena import design_named, preset_named

if TYPE_CHECKING:
    from pa_ros.perception.calibration import Cameras


@pytest.fixture(scope="session")
def calibration() -> Cameras:
    pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
    from pa_ros.perception.calibration import Cameras
    from pa_ros.perception.task import calibrate

    opengl()
    above = calibrate(preset_named("fast"), design_named("3-D"), "above", 240, enough=160)
    return Cameras((above,))
