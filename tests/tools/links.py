"""Three hosts as in test_machines_graph.py, one of them behind a bad link: 2 % of the Ethernet
frames lost, 20 ± 10 ms delay each way, reordered; then cut for 30 s. Minutes: `make links`."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hosts import hosts
from sites import NO_HOSTS, SUBNET, Site, ended
from waiting import wait_for

from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import verify

pytestmark = [pytest.mark.graph, pytest.mark.skipif(bool(NO_HOSTS), reason=NO_HOSTS or "-")]
BY_THE_CLOCK = {"mode": "real_time", "real_time_factor": 5.0, "command_timeout_s": 2.0}
WAYS: dict[str, dict[str, object]] = {"arrival": {}, "free": BY_THE_CLOCK}
BAD = ("--loss", "0.02", "--delay-ms", "20", "--jitter-ms", "10")
CUT_S = 30.0
SPAN_S = 20.0  # of each measurement
TOPICS = ["trajectories", "policy_weights", "provenance"]


@pytest.fixture
def three(tmp_path: Path) -> Iterator[Site]:
    with hosts(3) as made:
        yield Site(made, tmp_path, lambda _: SUBNET)


def frames_per_s(site: Site) -> float:
    """The learner's, over SPAN_S."""
    before, began = site.frames, time.monotonic()
    time.sleep(SPAN_S)
    return (site.frames - before) / (time.monotonic() - began)


def heard_of(site: Site, agent: str) -> int:
    """Trajectories of an agent that the learner's newest checkpoint has."""
    return int(site.ledger["accounts"][agent]["next"])


def gaps(site: Site) -> list[list[int]]:
    """Trajectories that the newest checkpoint misses."""
    return [gap for account in site.ledger["accounts"].values() for gap in account["gaps"]]


@pytest.mark.parametrize("way", WAYS)
def test_a_bad_link_that_is_cut_for_half_a_minute_loses_nothing_unsaid(three: Site, way: str):
    site, figures = three, dict[str, Any](in_step=way)
    bag = site.folder / "bag"
    topics = [*TOPICS, *(f"arena{i}/{name}" for i in (1, 2) for name in TOPICS[2:])]
    site.record(bag, [*topics, "arena1/arena_info", "arena2/arena_info"])
    site.begin(f"learner.schedule.in_step={way}", sim=WAYS[way], checkpoint_every_frames=500)
    site.learns()
    figures["frames_per_s_good"] = frames_per_s(site)
    site.hosts.worsen(2, *BAD, log=site.folder / "link.log")
    site.learns()
    figures["frames_per_s_bad"] = frames_per_s(site)
    site.hosts.cable(2, plugged=False)
    figures["frames_per_s_cut"] = frames_per_s(site)  # of the other arena alone
    time.sleep(CUT_S - SPAN_S)
    site.hosts.cable(2, plugged=True)
    before, healed = heard_of(site, "arena2"), time.monotonic()
    wait_for(lambda: heard_of(site, "arena2") > before + 3, "the arena behind the link")
    figures["healed_after_s"] = time.monotonic() - healed
    site.learns(1000)
    wait_for(lambda: not gaps(site), "what was missed, sent again or given up")
    accounts = ended(site)
    figures |= {name: site.ledger[name] for name in ("lost", "duplicates", "too_old")}
    assert accounts.keys() == {"arena1", "arena2"}
    assert way == "free" or (site.ledger["lost"] == 0 and not gaps(site))
    with Bag(bag) as opened:
        found = verify(Experience(opened))
    figures |= {"versions_equal": found.compared, "transitions_denied": found.altered}
    print(json.dumps({k: round(v, 1) if isinstance(v, float) else v for k, v in figures.items()}))
    assert not found.altered and found.compared > 0
