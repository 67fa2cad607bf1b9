"""Fleets: in step, recorded with all that verifies them; and free, where nobody waits."""

import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from helpers.recordings import SMALL, launched
from helpers.waiting import DEADLINE_S
from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import verify
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import DomainClaim
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters, fleet, in_step
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics

pytestmark = pytest.mark.graph
PARAMETERS = {
    "sim_node": {"seed": 4, "eval_every_episodes": 2},
    "agent_node": {"seed": 4, "learning": True, "weights": "topic"},
    "learner_node": {"seed": 4, **SMALL},
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with DomainClaim() as claim, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(claim.number))
        return record(tmp_path_factory.mktemp("launched"))


def record(folder: Path) -> Path:
    """A short run of a graph, launched in a folder and interrupted; its bag."""
    fleet = "--arenas", "2", "--in-step", "exact", "--compose"
    bag, out = launched(folder, PARAMETERS, 3_000_000, *fleet)
    names = [f"arena{number}.sim_node+agent_node" for number in (1, 2)]
    assert ", ".join(["recorder", *names, "learner_node"]) in out
    return bag


def test_a_run_in_step_is_verified_from_its_first_step(bag):
    """One seed has one result: the learner's updates are computed again from the bag."""
    with Bag(bag) as opened:
        experience = Experience.read(opened)
        found = verify(experience)
    assert found.equal, (found.difference, found.incomplete, found.altered, found.named)
    assert all(version % 2 == 0 for version in experience.published)  # a round has two trajectories
    assert found.compared >= 3
    assert found.checked >= found.frames > 300


def test_every_process_says_what_it_is(bag):
    with Bag(bag) as opened:
        origins = {origin.node: origin for origin in Experience.read(opened).origins}
    nodes = [f"/arena{number}/{name}_node" for number in (1, 2) for name in ("agent", "sim")]
    assert sorted(origins) == [*nodes, "/learner_node"]
    assert origins["/arena2/sim_node"].seed == 5
    assert origins["/arena1/sim_node"].parameters["eval_every_episodes"] == 2
    assert SMALL.items() <= origins["/learner_node"].parameters.items()


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
        told = lambda name: figures.value("learner_node", name) or 0  # noqa: E731
        # The two are counted one after the other.
        assert until(lambda: told("rejected_trajectories") >= told("refused.learning.too_old"))
