"""A graph with arena and agent in one process is recorded, with all that is needed to verify it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from helpers.recordings import SMALL, launched
from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import verify
from pa_ros.tools.domain import DomainClaim

pytestmark = pytest.mark.graph
PARAMETERS = {
    "/**/sim_node": {"seed": 4, "eval_every_episodes": 2},
    "/**/agent_node": {"seed": 4, "learning": True, "weights": "topic"},
    "/**/learner_node": {"seed": 4, **SMALL},
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with DomainClaim() as claim, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(claim.number))
        return record(tmp_path_factory.mktemp("launched"))


def record(folder: Path) -> Path:
    """A short run of a graph, launched in a folder and interrupted; its bag."""
    bag, out = launched(folder, PARAMETERS, 1_500_000, "--compose")
    assert "recorder, sim_node+agent_node, learner_node" in out
    return bag


def test_a_graphs_run_is_verified_from_its_first_step(bag):
    with Bag(bag) as opened:
        found = verify(Experience(opened))
    assert found.equal, found
    assert found.compared == found.version + 1 > 3
    assert found.checked >= found.frames > 300


def test_every_process_says_what_it_is(bag):
    with Bag(bag) as opened:
        origins = {origin.node: origin for origin in Experience(opened).origins}
    assert sorted(origins) == ["/agent_node", "/learner_node", "/sim_node"]
    assert {origin.seed for origin in origins.values()} == {4}
    assert origins["/sim_node"].parameters["eval_every_episodes"] == 2
    assert SMALL.items() <= origins["/learner_node"].parameters.items()
    about = yaml.safe_load((bag / "metadata.yaml").read_text())
    custom = about["rosbag2_bagfile_information"]["custom_data"]
    assert custom["pa_ros.provenance"].count('"node"') == 3
