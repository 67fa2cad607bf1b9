"""One calibration for all tests that see."""

import pytest

from helpers.pictures import opengl
from pa_ros.arena import design_named, preset_named

pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
from pa_ros.perception.calibration import Calibration
from pa_ros.perception.task import calibrate


@pytest.fixture(scope="session")
def calibration() -> Calibration:
    opengl()
    return calibrate(preset_named("fast"), design_named("3-D"), "above", 240, enough=160)
