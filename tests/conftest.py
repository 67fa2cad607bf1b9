"""One thread for torch, no deadlines for hypothesis, and a separate ROS domain for each test."""

import os
from collections.abc import Iterator

import hypothesis
import pytest

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy is loaded; processes that tests start inherit it

import torch

from helpers.waiting import Clock
from pa_ros.tools.domain import DomainClaim

NICE = 10
GROUPS = {  # of tests with a graph: folders, or how files begin; all others are `nodes`
    "tools": ("tools", "cli", "console"),
    "robots": ("lab", "ros", "test_robot_"),
}
torch.set_num_threads(1)
# On a busy machine a case may take long; tests never check how long.
hypothesis.settings.register_profile("no deadline", deadline=None)
hypothesis.settings.load_profile("no deadline")
os.environ["ROS_DOMAIN_ID"] = UNMARKED = "a test without the marker `graph`"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Share the tests among four processes (`-n 4`): each group of graphs, which mostly wait and
    take about as long as another, has its own, and so have the tests without a graph."""
    for item in items:
        if item.get_closest_marker("graph") is not None:
            folder, file = item.path.parent.name, item.path.name
            groups = (group for group, names in GROUPS.items()
                      if folder in names or file.startswith(names))  # fmt: skip
            item.add_marker(pytest.mark.xdist_group(f"graph-{next(groups, 'nodes')}"))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Give graphs, which have deadlines, priority over tests that only compute."""
    beside_others = "PYTEST_XDIST_WORKER" in os.environ
    if beside_others and item.get_closest_marker("graph") is None and os.nice(0) == 0:
        os.nice(NICE)


@pytest.fixture(scope="module")
def module_domain() -> Iterator[str]:
    """A ROS domain for a graph that the tests of a module share."""
    with DomainClaim() as claim, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(claim.number))
        yield str(claim.number)


@pytest.fixture(autouse=True)
def ros_domain(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """An unused ROS domain for a test that is marked `graph`; ROS does not start without the
    marker."""
    if request.node.get_closest_marker("graph") is None:
        yield UNMARKED
        return
    if "module_domain" in request.fixturenames:
        yield os.environ["ROS_DOMAIN_ID"]
        return
    with DomainClaim() as claim:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(claim.number))
        yield os.environ["ROS_DOMAIN_ID"]


@pytest.fixture
def clock() -> Clock:
    """A clock that the test sets."""
    return Clock()
