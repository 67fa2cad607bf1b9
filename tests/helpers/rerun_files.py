"""What files for Rerun say."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def columns(path: Path) -> dict[str, list[Any]]:
    """What a file for Rerun says, by "entity component": (simulation time in s, value) in order."""
    from rerun.chunk import RrdReader

    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if "sim_time" not in batch.schema.names:
            continue
        times = [round(time.total_seconds(), 6) for time in batch.column("sim_time").to_pylist()]
        for name in batch.schema.names:
            if ":" in name:
                rows = found.setdefault(f"{chunk.entity_path} {name}", [])
                rows += zip(times, batch.column(name).to_pylist(), strict=True)
    return {name: sorted(rows, key=lambda row: row[0]) for name, rows in found.items()}
