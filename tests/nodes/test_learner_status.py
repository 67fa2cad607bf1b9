"""What a learner reports: OK only while it learns, and how many trajectories are missing."""

import pytest

from learner_node.status import AT_WORK_S, IDLE_S, REFUSED_S, LearnerStatus
from pa_ros.ros.health import ERROR, OK, WARN


class Reporting:
    """A status, as it is reported while frames grow."""

    def __init__(self, clock) -> None:
        self.clock, self.status = clock, LearnerStatus(clock)

    def report(self, trouble="", missing=0, backlog=0, frames=None, awaited="") -> tuple[int, str]:
        frames = self.clock.now if frames is None else frames
        return self.status.state(trouble, missing, backlog, frames, awaited)

    def arrive(self, *agents: str, times: int = 20, every_s: float = 0.3) -> None:
        for _ in range(times):
            for agent in agents:
                self.status.arrived(agent)
            assert self.report() == (OK, "learning")
            self.clock.now += every_s


@pytest.fixture
def learner(clock) -> Reporting:
    return Reporting(clock)


def test_a_learner_is_ok_only_while_trajectories_arrive(learner, clock) -> None:
    level, message = learner.report()
    assert level == WARN and "parameter learning" in message
    learner.arrive("a")
    clock.now += IDLE_S
    level, message = learner.report()
    assert level == WARN and message.startswith("no trajectory for 2 s: do sim_node")
    assert learner.report(backlog=3) == (OK, "learning")  # it is slow, not idle
    learner.arrive("a", times=1)


def test_patience_adapts_to_the_usual_time_between_trajectories(learner, clock) -> None:
    learner.arrive("a", every_s=10.0)
    clock.now += 30.0
    assert learner.report()[0] == WARN


def test_duplicates_alone_are_not_learning(learner, clock) -> None:
    learner.arrive("a")
    learner.report(frames=7.0)
    for _ in range(20):
        learner.status.arrived("a")
        clock.now += 0.3
    level, message = learner.report(frames=7.0)
    assert level == WARN and message.startswith("all trajectories of the last 6 s are duplicates")


def test_refusals_missing_trajectories_and_errors_are_reported(learner, clock) -> None:
    learner.status.arrived("a")
    learner.status.refused("trajectories: expected 5 objects, got 64")
    assert learner.report() == (WARN, "refuses trajectories: expected 5 objects, got 64")
    clock.now += REFUSED_S
    learner.status.arrived("a")
    assert learner.report(missing=2)[1].startswith("2 trajectories are missing")
    assert learner.report(trouble="disk full") == (ERROR, "disk full")
    assert learner.status.at_work("a") and not learner.status.at_work("b")
    clock.now += AT_WORK_S
    assert not learner.status.at_work("a")


def test_a_silent_agent_is_named_and_later_forgotten(learner, clock) -> None:
    learner.arrive("fast", "slow")
    reports = []
    for _ in range(60):
        learner.status.arrived("fast")
        reports.append(learner.report())
        clock.now += 0.3
    assert reports[0] == reports[-1] == (OK, "learning")
    assert any(message.startswith("no trajectory of 'slow'") for _, message in reports)


def test_the_agent_that_all_others_wait_for_is_named(learner, clock) -> None:
    learner.arrive("a")
    learner.report(frames=7.0, backlog=3, awaited="b")
    clock.now += IDLE_S + 1
    learner.status.arrived("a")
    level, message = learner.report(frames=7.0, backlog=3, awaited="b")
    assert level == WARN and message.startswith("waits for the next trajectory of 'b'")
