"""Which arena the page shows when none was named."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest
from graph import graph

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.console import live
from pa_ros.console.live import LiveConsole
from pa_ros.console.sampler import within
from pa_ros.ros import topics

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(
    ("seen", "shown"),
    [
        ([("/other",), ("/", "/other")], ""),  # the one asked for is discovered last
        ([("/other",), ("/other",)], "other"),  # it isn't there
        ([("/a",), ("/a", "/b"), ("/a", "/b")], "a"),
    ],
)
def test_another_namespaces_arena_is_turned_to_once_it_was_seen_twice(monkeypatch, seen, shown):
    monkeypatch.setattr(live, "SURVEY_S", 0.0)
    with graph() as probe:
        console = LiveConsole(probe, MagicMock(), MagicMock(), "")
        surveys = iter(seen)
        monkeypatch.setattr(console, "_survey", lambda: next(surveys))
        for _ in seen:
            console.tick(pages=0)
        program = within(shown, topics.PROGRAM)  # where what is typed would go
        assert probe.until(lambda: probe.count_publishers(program) == 1)
