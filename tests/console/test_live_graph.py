"""A running graph on the page: which arena it shows, and what its controls ask of the arena."""

from unittest.mock import MagicMock

import numpy as np
import pytest

from helpers.graph import graph

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.arena.rearranging import bodies
from pa_ros.console import live, serve
from pa_ros.console.controls import Controls
from pa_ros.console.live import LiveConsole
from pa_ros.console.services import ArenaServices
from pa_ros.console.settings import ConsoleSettings
from pa_ros.ros import topics
from pa_ros.ros.refusals import Refusals
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def sends_to(namespace: str) -> str:
    return topics.PROGRAM.within(f"/{namespace}").name


@pytest.mark.parametrize(
    ("seen", "shown"),
    [
        ([("/other",), ("/", "/other")], ""),  # the one asked for is discovered last
        ([("/other",), ("/other",)], "other"),  # the one asked for is not running
    ],
)
def test_another_arena_is_shown_once_it_was_seen_twice(monkeypatch, seen, shown):
    monkeypatch.setattr(live, "SURVEY_S", 0.0)
    with graph() as probe:
        console = LiveConsole(probe, MagicMock(), MagicMock(), "")
        surveys = iter(seen)
        monkeypatch.setattr(live, "namespaces_of_arenas", lambda _: next(surveys))
        for _ in seen:
            console.tick(pages=0)
        assert probe.until(lambda: probe.count_publishers(sends_to(shown)) == 1)


def test_a_wrong_request_of_a_page_is_logged_and_ends_nothing(monkeypatch):
    said: list[str] = []
    refusals = Refusals(said.append, period_s=0.0)
    for module in (live, serve):
        monkeypatch.setattr(module, "Refusals", lambda _: refusals)
    monkeypatch.setattr(serve, "REFRESH_S", 0.0)
    broken = MagicMock(spec=Controls)
    broken.refresh.side_effect = ValueError("no such block")
    monkeypatch.setattr(serve, "Visitors", lambda *_: MagicMock(controls=[broken]))
    with graph() as probe:
        console = LiveConsole(probe, MagicMock(), MagicMock(), "")
        console.choose("a b")
        console.do(lambda: console.services.set_speed(-1.0))
        console.tick(pages=0)
        assert probe.until(lambda: probe.count_publishers(sends_to("")) == 1)
        assert any("got 'a b'" in line for line in said)
        with serve.beside(probe, ConsoleSettings(port=0)):
            assert probe.until(lambda: any("no such block" in line for line in said))


def test_a_block_is_moved_by_its_number():
    with graph(SimNode, sim_node__design="3-D", sim_node__seed=2) as probe:
        services, task = ArenaServices(probe, ""), probe.nodes[0].session.task
        services.move(1, 0.45, -0.3)
        assert probe.until(lambda: ": done" in services.html())
        assert bodies(task)[2].position[:2] == pytest.approx([0.45, -0.3])
        before = np.array([body.position for body in bodies(task)])
        services.move(0, 0.45, -0.3)  # where the other is
        assert probe.until(
            lambda: "move" in services.html() and "every other block" in services.html()
        )
        services.move(99, 0.0, 0.3)
        assert probe.until(lambda: "blocks, got number 99" in services.html())
        assert np.array([body.position for body in bodies(task)]) == pytest.approx(before)
