"""On what software and machine something was made."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("programmable-agents", "mujoco", "torch", "numpy", "ros-jazzy-rclpy")


def versions() -> str:
    """`name version` of what the figures depend on; packages that are absent are left out."""
    found = [f"python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def here() -> str:
    """This machine, and what is installed on it."""
    return f"{versions()}, on {device()}"


def device() -> str:
    """The processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())
