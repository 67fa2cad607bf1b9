"""A learner on one host, an arena with its agent on each of two others, and a cable that is
pulled and plugged in again. The hosts are network namespaces that the test makes."""

import time
from pathlib import Path

import pytest

from helpers.hosts import NO_HOSTS, SUBNET, Site, ended, hosts
from helpers.waiting import wait_for

pytestmark = [pytest.mark.graph, pytest.mark.skipif(bool(NO_HOSTS), reason=NO_HOSTS or "-")]
CUT_S = 3.0


def shared_memory() -> set[str]:
    return {path.name for path in Path("/dev/shm").glob("*fastrtps*")}


def test_arenas_on_other_hosts_train_a_learner_and_a_cut_cable_loses_nothing(tmp_path: Path):
    before = shared_memory()
    with hosts(3) as made:
        site = Site(made, tmp_path, lambda host: SUBNET)
        site.begin()
        site.learns()
        site.hosts.cable(2, plugged=False)
        site.learns()  # the other arena is not held up
        time.sleep(CUT_S)
        site.hosts.cable(2, plugged=True)
        site.learns(1000)
        accounts = ended(site)
    assert accounts.keys() == {"arena1", "arena2"}
    assert all(account["gaps"] == [] for account in accounts.values())
    wait_for(lambda: not shared_memory() - before, "the end of the middleware's shared memory")
