"""What the console asks of an arena's services, and what it says of the answers."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.graph import graph

pytest.importorskip("viser", reason="the extra `console` is not installed")

from pa_ros.arena.rearranging import bodies
from pa_ros.console.services import ArenaServices
from sim_node.node import SimNode

pytestmark = pytest.mark.graph


def test_a_block_is_put_elsewhere_by_its_number():
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
