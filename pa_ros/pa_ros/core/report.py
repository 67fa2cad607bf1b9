"""Flat JSON reports: dotted names and numbers, beside strings that say how they were taken."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("programmable-agents", "mujoco", "torch", "numpy", "ros-jazzy-rclpy")

Report = Mapping[str, float | int | str]


def versions() -> str:
    """`name version` of what the figures depend on; packages that are absent are left out."""
    found = [f"python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def device() -> str:
    """The processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def write_report(path: Path | None, report: Report) -> None:
    """Print a report, a line a name, and write it to `path` if one is given."""
    width = max(map(len, report))
    for name, value in report.items():
        print(f"{name:<{width}}  {f'{value:.6g}' if isinstance(value, float) else value}")
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(report, indent=2) + "\n")
