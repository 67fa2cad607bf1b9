"""Two composed arenas in step are recorded, with all that is needed to verify what was learned."""

from pathlib import Path

import pytest

from helpers.recordings import SMALL, launched
from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import verify
from pa_ros.tools.domain import DomainClaim

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
