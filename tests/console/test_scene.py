"""The scene holds what it shows, and nothing of what it has shown."""

from __future__ import annotations

import gc
import weakref

import pytest

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.bags.film import Stage
from pa_ros.console import scene
from pa_ros.console.moment import Moment
from pa_ros.console.scene import ArenaScene
from pa_ros.console.server import ConsoleServer, ConsoleSettings
from pa_ros.provenance.origins import describe

ARENA, DESIGN = preset_named("fast"), design_named("3-D")


@pytest.fixture
def no_collector():
    """What is in a circle stays."""
    gc.disable()
    yield
    gc.enable()


def moments(count: int):
    """The beginnings of episodes, each with blocks of its own."""
    task, about = ReachTask(ARENA, DESIGN, 2), describe(ARENA, DESIGN, 2, (), "arena")
    for episode in range(count):
        observation, _ = task.reset(episode)
        yield Moment(about, observation, False, "")


def test_scenes_that_are_gone_leave_at_once(no_collector, monkeypatch):
    """A page that stays open while an arena learns sees another scene every second."""
    made: list[weakref.ref] = []

    class Remembered(Stage):
        def __init__(self, *given):
            super().__init__(*given)
            made.extend((weakref.ref(self), weakref.ref(self.task.simulation)))

    monkeypatch.setattr(scene, "Stage", Remembered)
    monkeypatch.setattr(scene, "REBUILD_S", 0.0)
    with ConsoleServer(ConsoleSettings(port=0)) as server:
        shown = ArenaScene(server.viser)
        assert all([shown.show(moment) for moment in moments(8)])
        assert len(made) == 16 and [ref() is None for ref in made] == [True] * 14 + [False] * 2
