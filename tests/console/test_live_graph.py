"""Which arena the page shows when none was named, and what pages ask for in vain."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest

from helpers.graph import graph

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.console import live, serve
from pa_ros.console.controls import Controls
from pa_ros.console.live import LiveConsole
from pa_ros.console.sampler import within
from pa_ros.console.server import ConsoleSettings
from pa_ros.console.services import ArenaServices
from pa_ros.ros import topics
from pa_ros.ros.refusals import Refusals

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
        monkeypatch.setattr(live, "namespaces_of_arenas", lambda _: next(surveys))
        for _ in seen:
            console.tick(pages=0)
        program = within(shown, topics.PROGRAM)  # where what is typed would go
        assert probe.until(lambda: probe.count_publishers(program) == 1)


def test_what_a_page_asks_for_in_vain_ends_nothing(monkeypatch):
    """An arena that was not offered, values that no service takes, controls that can't be drawn."""
    said = list[str]()
    refusals = Refusals(said.append, period_s=0.0)
    monkeypatch.setattr(live, "Refusals", lambda _: refusals)
    monkeypatch.setattr(serve, "Refusals", lambda _: refusals)
    monkeypatch.setattr(serve, "REFRESH_S", 0.0)
    broken = MagicMock(spec=Controls)
    broken.refresh.side_effect = ValueError("no such block")
    monkeypatch.setattr(serve, "Visitors", lambda *_: MagicMock(controls=[broken]))
    with graph() as probe:
        console = LiveConsole(probe, MagicMock(), MagicMock(), "")
        console.choose("a b")
        console.ask("reset", float("inf"))
        console.ask("fly", 1.0)
        console.tick(pages=0)
        assert probe.until(lambda: probe.count_publishers(within("", topics.PROGRAM)) == 1)
        assert any("got 'a b'" in line for line in said) and any("'fly'" in line for line in said)
        with serve.beside(probe, ConsoleSettings(port=0, rate_hz=30.0)):
            assert probe.until(lambda: any("no such block" in line for line in said))
    assert set(refusals.counts) == {"console.page"}


def test_an_answer_that_cannot_be_read_is_said():
    node, future = MagicMock(), MagicMock()
    services = ArenaServices(node, "")
    asked = node.create_client.return_value.call_async.return_value
    for ask in (lambda: services.ask("pause", 1.0), lambda: services.move(0, 0.3, 0.3)):
        ask()
        future.result.side_effect = RuntimeError("the arena is gone")
        asked.add_done_callback.call_args[0][0](future)
        assert "the arena is gone" in services.html()
