"""What RESULTS says of the detectors is what their committed table says."""

from __future__ import annotations

import csv
from pathlib import Path
from statistics import fmean

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("word", ["new shape", "new color"])
def test_degrees_of_what_was_never_seen_are_stated(word: str):
    with (ROOT / "docs/results/detectors.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["word"] == word]
    assert len(rows) == 10
    on, off, order = (
        fmean(float(row[of]) for row in rows) for of in ("on", "best_distractor", "separated")
    )
    results = (ROOT / "RESULTS.md").read_text()
    assert f"{word} {on:.2f} against {off:.2f}" in results
    assert f"in this order in {order:.0%}".replace("%", " %") in results
