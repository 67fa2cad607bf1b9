"""RESULTS.md states what the tables in docs/results say."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import results_tables  # noqa: E402  (a script beside the docs)


@pytest.mark.parametrize("page", results_tables.PAGES, ids=lambda page: page.name)
def test_make_results_leaves_the_page_unchanged(page):
    assert results_tables.filled(page.read_text()) == page.read_text()


def test_shares_of_seeds_have_exact_intervals() -> None:
    beta = pytest.importorskip("scipy.stats").beta
    for successes, count in ((10, 10), (3, 10), (0, 3), (1, 2)):
        low, high = results_tables.share_interval(successes, count)
        assert low == pytest.approx(
            beta.ppf(0.025, successes, count - successes + 1) if successes else 0, abs=1e-9
        )
        assert high == pytest.approx(
            beta.ppf(0.975, successes + 1, count - successes) if successes < count else 1, abs=1e-9
        )
    assert results_tables.share_interval(10, 10)[0] == pytest.approx(0.69, abs=0.005)
