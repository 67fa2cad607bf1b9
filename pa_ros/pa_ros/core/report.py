"""Flat JSON reports: dotted names and numbers, beside strings that say how they were taken."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

from pa_ros.core.files import write_whole

Report = Mapping[str, float | int | str]


def write_report(path: Path | None, report: Report) -> None:
    """Print a report, a line a name, and write it to `path` if one is given."""
    width = max(map(len, report))
    for name, value in report.items():
        print(f"{name:<{width}}  {f'{value:.6g}' if isinstance(value, float) else value}")
    if path is not None:
        write_whole(path, json.dumps({k: _json(v) for k, v in report.items()}, indent=2) + "\n")


def _json(value: float | int | str) -> float | int | str:
    """JSON has no NaN and no infinity: they are text."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
