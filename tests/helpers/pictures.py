"""Rendered pictures and films: is OpenGL available, where is a place seen, what captions say."""

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from pa_ros.arena import ReachTask, RenderError, design_named, preset_named
from pa_ros.arena.render import draw


def opengl() -> None:
    """Skip the test where OpenGL is missing."""
    missing = _missing()
    if missing:
        pytest.skip(f"no OpenGL: {missing}")


@lru_cache(maxsize=1)
def _missing() -> str:
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    task.reset(0)
    try:
        draw(task, 16, rendered=True)
    except RenderError as error:
        return str(error)
    return ""


def pixel_of(place: Any, matrix: Any, position: Any, quaternion: Any) -> Any:
    """The pixel (u, v) at which a camera sees a place [3] m, by K and the optical frame's pose
    (quaternion xyzw)."""
    x, y, z, w = quaternion
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = np.asarray(matrix).reshape(3, 3) @ turn.T @ (np.asarray(place) - position)
    assert seen[2] > 0, "behind the camera"
    return seen[:2] / seen[2]


def captions(monkeypatch: pytest.MonkeyPatch, where: str) -> list[list[str]]:
    """A list that collects the captions of all pictures; `where` names the replaced function."""
    said: list[list[str]] = []

    def caption(picture: Any, lines: list[str], color: str = "") -> Any:
        said.append(lines)
        return picture

    monkeypatch.setattr(where, caption)
    return said
