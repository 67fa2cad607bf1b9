"""Several arenas feed one learner, and none of them holds up the others."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.recordings import SMALL
from helpers.waiting import DEADLINE_S
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import present, start_nodes, watch
from pa_ros.tools.launch_params import Parameters, fleet
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

pytestmark = pytest.mark.graph
ONE: Parameters = {
    "sim_node": {"seed": 4},
    "agent_node": {"seed": 4, "learning": True, "weights": "topic"},
    "learner_node": {"seed": 4, **SMALL},
}


def test_two_arenas_feed_one_learner_and_the_death_of_one_does_not_stop_it(tmp_path: Path):
    figures, parameters = GraphFigures(), fleet(ONE, 2)

    def of_both(least: int) -> bool:
        """Whether both agents have sent so many trajectories, all of them learned from."""
        sent = figures.value("agent_node", "trajectories", min) or 0
        learned = figures.value("learner_node", "version") or 0
        return sent >= least and learned >= 2 * least

    with Supervisor(tmp_path / "log") as supervisor, client_node("watcher") as node:
        watch_diagnostics(node, figures)
        start_nodes(supervisor, parameters, tmp_path)
        assert watch(node, supervisor, lambda: None, lambda: of_both(3), DEADLINE_S)
        named = lambda: {"/arena1", "/arena2"} <= dict(figures.rows()).keys()  # noqa: E731
        gathered = lambda: named() and present(node, parameters) == set(parameters)  # noqa: E731
        assert watch(node, supervisor, lambda: None, gathered, DEADLINE_S)
        assert figures.value("learner_node", "missing_trajectories") == 0
        assert dict(figures.rows())["refused messages"] == "0"
        supervisor.stop(["arena2.sim_node"])
        then = figures.value("learner_node", "version") or 0
        assert watch(
            node, supervisor, lambda: None,
            lambda: (figures.value("learner_node", "version") or 0) >= then + 5, DEADLINE_S,
        )  # fmt: skip
        assert figures.value("learner_node", "missing_trajectories") == 0
