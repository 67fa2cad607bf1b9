"""Whether MuJoCo can be imported at all, with the OpenGL that it is told to use."""

from __future__ import annotations

import importlib
import os

from pa_ros.core.errors import ConfigError


def check_opengl() -> None:
    """MuJoCo loads what MUJOCO_GL names when it is imported. ConfigError if that can't be."""
    name = os.environ.get("MUJOCO_GL")
    if not name:
        return
    try:
        importlib.import_module("mujoco")
    except Exception as error:  # each OpenGL back end has its own kinds of failure
        raise ConfigError(
            f"MUJOCO_GL={name}: expected an OpenGL that this machine has, got "
            f"{type(error).__name__}: {error}; without the variable all but rendering works"
        ) from error
