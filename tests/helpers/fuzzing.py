"""Fuzzing by hypothesis, in parts with seeds of their own, so that a million cases fit in memory.

`make test` looks at a small, fixed share of the cases; `make fuzz` at all (PA_ROS_FUZZ=1).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

SHARE = float(os.environ.get("PA_ROS_FUZZ", "0.001"))
FEWEST, PART = 50, 2_000
Case = TypeVar("Case")


def explore(cases: st.SearchStrategy[Case], check: Callable[[Case], object], whole: int) -> int:
    """Check our share of `whole` cases; how many it were."""
    wanted, looked = max(FEWEST, round(whole * SHARE)), 0

    def look(case: Any) -> None:
        nonlocal looked
        looked += 1
        check(case)

    for number, size in enumerate(_parts(wanted)):
        within = settings(
            max_examples=size, deadline=None, database=None, suppress_health_check=list(HealthCheck)
        )
        seed(number)(within(given(cases)(look)))()
    assert looked >= min(wanted, FEWEST), "these cases are soon exhausted"
    return looked


def _parts(wanted: int) -> Iterator[int]:
    for begun in range(0, wanted, PART):
        yield min(PART, wanted - begun)
