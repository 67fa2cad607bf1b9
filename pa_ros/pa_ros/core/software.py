"""The software and the machine that something was made on."""

from __future__ import annotations

import importlib
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pa_ros.core.errors import ConfigError

PACKAGES = ("programmable-agents", "mujoco", "torch", "numpy", "ros-jazzy-rclpy")


def versions() -> str:
    """`name version` of the packages that results depend on; missing packages are left out."""
    found = [f"python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def here() -> str:
    """The installed versions and the processor."""
    return f"{versions()}, on {device()}"


def device() -> str:
    """The processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def check_opengl() -> None:
    """Raise ConfigError if MUJOCO_GL names an OpenGL that cannot be loaded.

    MuJoCo loads it when it is imported, and each kind of OpenGL fails with its own error.
    """
    name = os.environ.get("MUJOCO_GL")
    if not name:
        return
    try:
        importlib.import_module("mujoco")
    except Exception as error:
        raise ConfigError(
            f"MUJOCO_GL={name}: expected an OpenGL that this machine has, got "
            f"{type(error).__name__}: {error}; without the variable all but rendering works"
        ) from error
