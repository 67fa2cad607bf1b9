"""Fleets in step: exact, one seed and one result; free, nobody waits."""

from __future__ import annotations

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
from pa_ros.ros.topics import POLICY_WEIGHTS
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters, fleet, in_step
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.wire import Message
from pa_ros.wire.learning import decode_weights, weights_checksum

pytestmark = pytest.mark.graph
ONE: Parameters = {
    "sim_node": {"seed": 4},
    "agent_node": {"seed": 4, "learning": True, "weights": "topic"},
    "learner_node": {"seed": 4, **SMALL},
}
ROUNDS = 4


def recorded(folder: Path) -> Path:
    """A bag of two arenas in step, launched as a person does, and interrupted."""
    folder.mkdir()
    bag, _ = launched(folder, ONE, 3_000_000, "--arenas", "2", "--in-step", "exact")
    return bag


def published(folder: Path) -> dict[int, str]:
    """The first versions that such a fleet publishes, with their hashes."""
    hashes: dict[int, str] = {}

    def hear(message: Message) -> None:
        snapshot = decode_weights(message).snapshot
        hashes.setdefault(snapshot.version, weights_checksum(snapshot))

    with Supervisor(folder / "log") as supervisor, client_node("watcher") as node:
        POLICY_WEIGHTS.subscribe(node, hear)
        start_nodes(supervisor, in_step(fleet(ONE, 2), "exact"), folder)
        enough = lambda: max(hashes, default=0) >= 2 * ROUNDS  # noqa: E731
        assert watch(node, supervisor, lambda: None, enough, DEADLINE_S)
    return hashes


def test_two_arenas_in_step_learn_the_same_bits_again_and_their_bag_is_verified(tmp_path: Path):
    with Bag(recorded(tmp_path / "recorded")) as opened:
        experience = Experience(opened)
        found = verify(experience)
    assert found.equal, found
    assert found.compared >= ROUNDS and found.checked >= found.frames
    again = published(tmp_path / "again")
    assert all(version % 2 == 0 for version in again)  # a round is two trajectories
    common = again.keys() & experience.published.keys()
    assert (
        max(common) >= ROUNDS and again[max(common)] == experience.published[max(common)].checksum
    )


def test_free_agents_act_on_while_the_learner_stands_still_and_what_gets_too_old_is_counted(
    tmp_path: Path,
):
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
        assert until(lambda: (figures.value("learner_node", "too_old_trajectories") or 0) > 0)
        learned = figures.value("learner_node", "frames") or 0
        assert until(lambda: (figures.value("learner_node", "frames") or 0) > learned)
        counted = figures.value("learner_node", "rejected_trajectories") or 0
        assert counted >= (figures.value("learner_node", "too_old_trajectories") or 0)
