"""RESULTS.md states what the tables in docs/results say."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import results_tables  # noqa: E402  (a script beside the docs)


@pytest.mark.parametrize("page", results_tables.PAGES, ids=lambda page: page.name)
def test_make_results_leaves_the_page_unchanged(page):
    assert results_tables.filled(page.read_text()) == page.read_text()


def test_failed_seeds_are_shown_with_their_scores():
    rows = results_tables.variants().splitlines()
    (noise,) = [row for row in rows if row.startswith("| more noise ")]
    assert "605: 0.89" in noise  # of 0.8979, which is not solved
