"""An extension that fails in the middle costs its episode, not the node or what was learned."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SCENE, TRAINED, graph
from helpers.learners import trained
from pa_ros.core.extensions import ExtensionError
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.ros import topics
from pa_ros.world import REWARDS, Reward
from pa_ros.world.relation import RELATIONS
from sim_node.node import SimNode

FAULTS: dict[str, Any] = {
    "None": lambda reward: None,
    "nan": lambda reward: reward * np.nan,
    "array": lambda reward: np.array([reward, reward]),
    "good": lambda reward: "good",
    "ZeroDivisionError": lambda reward: 1 / 0,
}
CALLS = {"left": inf}  # after so many the reward fails


@dataclass(frozen=True)
class Fragile(Reward):
    """+1 and −1, until it fails."""

    fault: int = 0

    def __call__(self, satisfied: Any, measure: Any) -> Any:
        CALLS["left"] -= 1
        reward = np.where(satisfied, 1.0, -1.0) + 0.0 * np.minimum(measure, 1.0)
        return [*FAULTS.values()][self.fault](reward) if CALLS["left"] < 0 else reward


REWARDS.register("fragile", Fragile)


@pytest.fixture(autouse=True)
def whole_again() -> Iterator[None]:
    CALLS["left"] = inf
    yield
    CALLS["left"] = inf


@pytest.mark.parametrize("fault", range(len(FAULTS)))
def test_a_fault_of_a_reward_names_its_file_and_saves_what_was_learned(
    tmp_path: Path, fault: int
) -> None:
    CALLS["left"] = 150
    with pytest.raises(ExtensionError, match=f"Fragile of the extension .*{[*FAULTS][fault]}") as e:
        trained(tmp_path / "run", Fragile(fault))
    assert __file__ in str(e.value) and "\n" not in str(e.value)
    assert read_metadata(tmp_path / "run")["counters"]["frames"] == 100


def test_a_fault_of_a_relation_names_it_and_the_file() -> None:
    def fragile(hand: Any, objects: Any) -> Any:
        CALLS["left"] -= 1
        return 0.0 * objects[..., 0] * hand[..., 0] if CALLS["left"] >= 0 else np.nan

    mine = replace(RELATIONS["ABOVE"], name="MINE", measure=fragile)
    places = np.zeros(3), np.ones((4, 3))
    assert mine.of_places(*places).tolist() == [0.0] * 4
    CALLS["left"] = 0
    with pytest.raises(ExtensionError, match="MINE: measure of the .*test_faults.py: .* got nan"):
        mine.of_places(*places)


@pytest.mark.graph
def test_an_arena_voids_the_episode_says_why_and_continues() -> None:
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, sim_node__reward="fragile") as probe:
        assert probe.reaches(3)
        CALLS["left"] = 0
        assert probe.until(lambda: "Fragile of the extension" in probe.message("sim_node"))
        CALLS["left"] = inf
        assert probe.call(topics.RESET, topics.RESET[1].Request()).success
        episode = probe.last(topics.OBJECT_FEATURES).episode
        assert probe.until(lambda: probe.last(topics.OBJECT_FEATURES).episode > episode)
        assert probe.until(lambda: probe.message("sim_node") == "running")
