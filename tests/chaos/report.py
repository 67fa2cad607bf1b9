"""A campaign as figures, and as the table of FAULTS.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from chaos.campaign import Row, failed_rows
from pa_ros.core.text import Report

HEAD = """# Faults

What happens when things break: each fault is done on purpose to a running graph, and looked at
from outside. Made by `{command}` ({cycles} cycles, {failed} of {rows} rows failed).

*Seen*: median time until a node says so in `/diagnostics`, as WARN, ERROR or a count; it must be
within 3 s (–: nobody has to, the fault is mended unnoticed or its process has no voice on the
graph). *Recovered*: median time after the fault was over until all nodes say OK and work advances.
*Lost*: trajectories that were published and are neither learned, refused, nor reported lost.
*Mis-joined*: recorded trajectories that a fresh arena denies when they are re-enacted. After each
cycle versions have advanced and never gone back, a learner has gone on from its newest whole
checkpoint, and in real time the arm has held while commands stopped; after each stage no process
and no shared memory is left.

| Fault | Injected | Seen, s | Recovered, s | Lost | Mis-joined | Verdict |
|---|---|---|---|---|---|---|
"""


def report(rows: Sequence[Row]) -> Report:
    """`chaos.*`: figures of all rows."""
    begun = [row for row in rows if row.cycles]
    return {
        "chaos.cycles": sum(len(row.cycles) for row in begun),
        "chaos.rows": len(begun),
        "chaos.lost": sum(row.lost for row in begun),
        "chaos.mis_joined": sum(row.mis_joined for row in begun),
        "chaos.failed_rows": failed_rows(begun),
    }


def write_table(path: Path, rows: Sequence[Row], command: str) -> None:
    """Rewrite the table, a row for each fault that was done; sections below it are kept."""
    _, found, kept = (path.read_text() if path.exists() else "").partition("\n## ")
    figures = report(rows)
    text = HEAD.format(
        command=command,
        cycles=figures["chaos.cycles"],
        failed=figures["chaos.failed_rows"],
        rows=figures["chaos.rows"],
    )
    made = map(_row, (row for row in rows if row.cycles))
    path.write_text(text + "".join(made) + found + kept)


def _row(row: Row) -> str:
    verdict = "; ".join(row.failures[:3]) if row.failures else "held"
    if row.failed and not row.failures:
        verdict = "trajectories lost or mis-joined"
    cells = (
        row.fault.name,
        str(len(row.cycles)),
        _time(row.median("seen_after")),
        _time(row.median("recovered_after"), "never"),
        str(row.lost),
        str(row.mis_joined),
        f"**failed**: {verdict}" if row.failed else verdict,
    )
    return "| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |\n"


def _time(value: float | None, none: str = "–") -> str:
    return none if value is None else f"{value:.1f}"
