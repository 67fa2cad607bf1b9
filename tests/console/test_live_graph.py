"""A running graph on the page: which arena it shows, and what its controls ask of the arena."""

from contextlib import closing
from unittest.mock import MagicMock

import numpy as np
import pytest

from helpers.graph import graph

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.arena.rearranging import bodies
from pa_ros.console import live, serve
from pa_ros.console.controls import Controls
from pa_ros.console.live import LiveConsole
from pa_ros.console.settings import ConsoleSettings
from pa_ros.ros.refusals import Refusals
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(
    ("seen", "shown"),
    [
        ([("/other",), ("/", "/other")], ""),  # the one asked for is discovered last
        ([("/other",), ("/other",)], "other"),  # the one asked for is not running
    ],
)
def test_another_arena_is_shown_once_it_was_seen_twice(monkeypatch, seen, shown):
    monkeypatch.setattr(live, "SURVEY_S", 0.0)
    arm = MagicMock()
    monkeypatch.setattr(live, "Arm", arm)
    with graph() as probe, closing(LiveConsole(probe, MagicMock(), MagicMock(), "")) as console:
        surveys = iter(seen)
        monkeypatch.setattr(live, "namespaces_of_arenas", lambda _: next(surveys))
        for _ in seen:
            console.tick(pages=0)
        console.ask("pause", lambda one: one.pause())
        assert probe.until(lambda: console.asked == "pause: done")
    assert arm.call_args[0] == (shown,) and arm.return_value.close.called


def test_a_wrong_request_of_a_page_is_logged_and_ends_nothing(monkeypatch):
    said: list[str] = []
    refusals = Refusals(said.append, period_s=0.0)
    for module in (live, serve):
        monkeypatch.setattr(module, "Refusals", lambda _: refusals)
    monkeypatch.setattr(serve, "REFRESH_S", 0.0)
    broken = MagicMock(spec=Controls)
    broken.refresh.side_effect = ValueError("no such block")
    monkeypatch.setattr(serve, "Visitors", lambda *_: MagicMock(controls=[broken]))
    with graph() as probe, closing(LiveConsole(probe, MagicMock(), MagicMock(), "")) as console:
        console.choose("a b")
        console.tick(pages=0)
        assert any("got 'a b'" in line for line in said)
        with serve.beside(probe, ConsoleSettings(port=0)):
            assert probe.until(lambda: any("no such block" in line for line in said))


def test_a_block_is_moved_by_its_number_and_a_program_is_sent():
    scene = {"sim_node__design": "3-D", "sim_node__seed": 2, "sim_node__program_source": "topic"}
    with (
        graph(SimNode, **scene) as probe,
        closing(LiveConsole(probe, MagicMock(), MagicMock(), "")) as console,
    ):
        session, task = probe.nodes[0].session, probe.nodes[0].session.task

        def said_of(request, text: str) -> bool:
            console.ask("move", request)
            return probe.until(lambda: text in console.asked)

        assert said_of(lambda arm: arm.move(1, 0.45, -0.3), "move: done")
        assert bodies(task)[2].position[:2] == pytest.approx([0.45, -0.3])
        before = np.array([body.position for body in bodies(task)])
        assert said_of(lambda arm: arm.move(0, 0.45, -0.3), "every other block")
        assert said_of(lambda arm: arm.move(99, 0.0, 0.3), "blocks, got number 99")
        assert np.array([body.position for body in bodies(task)]) == pytest.approx(before)
        assert probe.until(lambda: console.vocabulary is not None)
        console.send("NEAR( HAND,RED )")
        console.tick(pages=0)
        assert probe.until(lambda: session.program is not None)
        assert session.program.program_id.startswith("console-")
        assert session.program.text == "NEAR(HAND, RED)"
        # There is no agent, which the page says once its patience is over.
        assert probe.until(lambda: console.asked.startswith("send: no answer"))
