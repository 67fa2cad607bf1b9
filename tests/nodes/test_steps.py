"""The messages of one control step find each other."""

from __future__ import annotations

from typing import Any

import pytest

from agent_node.errors import StaleObservationError
from agent_node.steps import StepMatcher


def test_steps_are_matched_by_stamp_in_any_order_and_old_ones_refused():
    matcher: Any = StepMatcher(("a", "b"))  # of any messages
    assert matcher.add("b", 10, "b10") is None
    assert matcher.add("a", 20, "a20") is None
    assert matcher.add("a", 10, "a10") == {"a": "a10", "b": "b10"}
    assert matcher.add("b", 20, "b20") == {"a": "a20", "b": "b20"}
    with pytest.raises(StaleObservationError, match="20"):
        matcher.add("a", 10, "again")
    assert matcher.add("a", 20, "a20") is None  # the newest may come again
    assert matcher.add("b", 20, "b20") is not None
    for stamp in range(30, 60):
        matcher.add("a", stamp, "lonely")  # the other parts never come: memory stays bounded
    assert matcher.add("b", 31, "b31") is None  # forgotten
    assert matcher.add("b", 59, "b59") == {"a": "lonely", "b": "b59"}
    matcher.restart()
    assert matcher.add("a", 1, "a") is None and matcher.add("b", 1, "b") is not None


def test_what_the_newest_step_waits_for_is_told():
    matcher: Any = StepMatcher(("a", "b"))
    assert matcher.lacking == []
    matcher.add("a", 10, "a10")
    matcher.add("b", 20, "b20")
    assert matcher.lacking == ["a"]
    matcher.add("a", 20, "a20")
    assert matcher.lacking == []
