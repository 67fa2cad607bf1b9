"""What RESULTS states, and the committed tables that its sentences are made of anew."""

from __future__ import annotations

import csv
from math import inf, isfinite
from pathlib import Path

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "docs/results"
RESULTS, README = (ROOT / "RESULTS.md").read_text(), (ROOT / "README.md").read_text()


def rows(name: str) -> list[dict[str, str]]:
    with (TABLES / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def column(name: str, field: str) -> list[float]:
    return [float(row[field]) for row in rows(name)]


def solved(name: str) -> int:
    """Seeds that are at 0.9 at the end, on the episodes used for nothing else."""
    return sum(score >= 0.9 for score in column(f"{name}-seeds", "final_held_out"))


def frames(name: str) -> list[float]:
    return [
        inf if value != value else value for value in column(f"{name}-seeds", "frames_to_solve")
    ]


def span(values: list[float], form: str = ",.0f", between: str = "–") -> str:
    found = [value for value in values if isfinite(value)]
    least, most = f"{min(found):{form}}", f"{max(found):{form}}"
    return least if least == most else f"{least}{between}{most}"


def summary(arm: str = "") -> dict[str, dict[str, float]]:
    found = rows(f"generalization-summary{arm}")
    return {
        row["condition"]: {k: float(v) for k, v in row.items() if k not in ("condition", "blind")}
        for row in found
    }


def short_of(table: str) -> dict[int, float]:
    """Seeds that end below 0.9, with where they are."""
    ends = {int(row["seed"]): float(row["final_held_out"]) for row in rows(f"{table}-seeds")}
    return {seed: end for seed, end in ends.items() if end < 0.9}


def check_stated(name: str, sentence: str) -> None:
    assert sentence in " ".join(RESULTS.split()), f"{name}: the tables say: {sentence}"
