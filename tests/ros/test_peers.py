"""Which peer a node follows: the one whose data arrive; every other one is ignored and named."""

from dataclasses import replace

import pytest

from helpers.learners import LEARNER, again
from pa_ros.core.experience import AgentKey
from pa_ros.ros.peers import (
    EARLY_S,
    REMEMBERED,
    REPORTED_S,
    SILENT_S,
    PeerMonitor,
    is_restarted_agent,
    is_restarted_learner,
)


class Peers(PeerMonitor[str]):
    """Follows peers whose description is a text; remembers each change."""

    def __init__(self, clock) -> None:
        self.changes: list[str] = []
        super().__init__("arena", self.changes.append, clock=clock)


@pytest.fixture
def peers(clock) -> Peers:
    """With the peer "one" that is followed, since its data arrive."""
    peers = Peers(clock)
    peers.described("one", "first")
    assert peers.received("one") and peers.changes == ["first"] and not peers.fault
    return peers


def test_the_newest_description_counts_until_data_arrive(clock):
    peers = Peers(clock)
    assert not peers.received("real")  # not described yet
    peers.described("stranger", "strange")
    assert peers.current == "strange"
    peers.described("real", "real one")
    assert peers.current == "real one" and peers.received("real")
    peers = Peers(clock)
    for name in ("real", "stranger"):
        peers.described(name, name)
    assert peers.current == "stranger" and peers.received("real") and peers.current == "real"


def test_a_description_without_data_never_replaces_a_living_peer(peers, clock):
    peers.described("other", "second")
    assert peers.current == "first" and "other describes itself, but sends nothing" in peers.fault
    clock.now += REPORTED_S
    assert not peers.fault  # it was one message
    peers.received("one")
    clock.now += SILENT_S
    peers.described("third", "third")
    assert peers.current == "first"  # silent, but nobody else sends data


def test_a_second_living_peer_is_ignored_and_named_until_it_is_gone(peers, clock):
    peers.described("other", "second")
    for _ in range(5):
        clock.now += SILENT_S / 2
        assert peers.received("one") and not peers.received("other")
        assert peers.fault.startswith("a second arena is ignored (other sends, too): stop it")
    clock.now += REPORTED_S
    assert peers.received("one") and not peers.fault and peers.changes == ["first"]


def test_a_silent_peer_is_replaced_by_one_whose_data_arrive(peers, clock):
    peers.described("other", "second")
    clock.now += SILENT_S
    assert peers.received("other") and peers.current == "second" and not peers.fault
    assert not peers.received("one") and "one sends, too" in peers.fault
    clock.now += SILENT_S
    assert peers.received("one") and peers.current == "first"


@pytest.mark.parametrize("silent_s", [0.0, SILENT_S])
def test_the_first_description_of_an_id_counts(peers, clock, silent_s):
    """Whether its peer is followed or not, at work or waiting: an id is new at every start."""
    peers.described("other", "second")
    clock.now += silent_s
    for name, first in (("one", "first"), ("other", "second")):
        peers.described(name, "forged")
        assert peers.current == "first" and f"{name} is described differently" in peers.fault
        peers.described(name, first)
    clock.now += SILENT_S
    assert peers.received("other") and peers.current == "second"


def test_the_first_description_of_an_id_counts_before_data_arrive(clock):
    peers = Peers(clock)
    for description in ("first", "forged", "first"):
        peers.described("one", description)
    assert peers.changes == ["first"] and "one is described differently" in peers.fault


def test_data_without_a_description_are_reported_unless_that_arrives_soon(peers, clock):
    assert not peers.received("nobody") and not peers.fault
    clock.now += EARLY_S + 0.1
    assert "nobody never described itself" in peers.fault


def test_a_peer_is_known_once_it_described_itself(peers):
    peers.described("another", "later")
    assert peers.knows("one") and peers.knows("another") and not peers.knows("nobody")


def test_memory_of_peers_is_bounded(peers):
    for number in range(10 * REMEMBERED):
        peers.described(f"{number}", str(number))
        assert not peers.received(f"undescribed {number}")
    assert peers.received("one") and len(peers.fault) < 100 * REMEMBERED


def test_a_learner_that_resumes_the_run_takes_over_at_its_first_data(clock):
    learners = PeerMonitor("learner", is_restart=is_restarted_learner, clock=clock)
    resumed, other = again(LEARNER, version=7), replace(LEARNER, learner_id="x", run_id="y")
    learners.described("learner", LEARNER)
    learners.received("learner")
    for info in (other, resumed):
        learners.described(info.learner_id, info)
        learners.received(info.learner_id)
    assert learners.current is resumed
    assert not learners.received("learner")


def test_a_restarted_agent_takes_over_and_another_agent_does_not(clock):
    agents = PeerMonitor[AgentKey]("agent", is_restart=is_restarted_agent, clock=clock)
    first, again_, other = AgentKey("a", 1), AgentKey("a", 2), AgentKey("b", 3)
    followed = [agents.received(key, key) for key in (first, first, other, again_, first)]
    assert followed == [True, True, False, True, False]
    assert "a/1 sends, too; b/3 sends, too" in agents.fault
