"""A free fleet: nobody waits for another."""

import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from helpers.recordings import SMALL
from helpers.waiting import DEADLINE_S
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters, fleet, in_step
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

pytestmark = pytest.mark.graph
ONE: Parameters = {
    "sim_node": {"seed": 4},
    "agent_node": {"seed": 4, "learning": True, "weights": "topic"},
    "learner_node": {"seed": 4, **SMALL},
}


def test_a_free_fleet_outlives_a_stopped_learner_and_the_learner_a_dead_arena(tmp_path: Path):
    """Agents act while the learner is stopped; trajectories of an old policy are then counted."""
    figures = GraphFigures()
    parameters = in_step(fleet(ONE, 2), "free")
    parameters["learner_node"]["learner.schedule.oldest_policy"] = 3

    def made(over: Callable[[Sequence[float]], float]) -> float:
        """Trajectories, over the agents that were heard of."""
        return figures.value("agent_node", "trajectories", over) or 0

    def underway() -> bool:  # both agents: one that came later would wait for its first weights
        return made(len) == 2 and made(min) >= 2 and bool(figures.value("learner_node", "frames"))

    with Supervisor(tmp_path / "log") as supervisor, client_node("watcher") as node:
        watch_diagnostics(node, figures)
        learner = start_nodes(supervisor, parameters, tmp_path)["learner_node"]

        def until(condition) -> bool:
            return watch(node, supervisor, lambda: None, condition, DEADLINE_S)

        assert until(underway)
        os.kill(learner, signal.SIGSTOP)
        try:
            then = made(min)
            assert until(lambda: made(min) >= then + 8)
        finally:
            os.kill(learner, signal.SIGCONT)
        assert until(lambda: (figures.value("learner_node", "refused.learning.too_old") or 0) > 0)
        assert dict(figures.rows()).keys() >= {"/arena1", "/arena2"}
        supervisor.stop(["arena2.sim_node"])
        learned = figures.value("learner_node", "version") or 0
        assert until(lambda: (figures.value("learner_node", "version") or 0) >= learned + 5)
        counted = figures.value("learner_node", "rejected_trajectories") or 0
        assert counted >= (figures.value("learner_node", "refused.learning.too_old") or 0)
