"""Experience joins only what belongs together, and each trajectory acts with its own weights."""

from __future__ import annotations

import numpy as np
import pytest

from agent_node.drivers import GreedyDriver, LearningDriver, Step
from agent_node.errors import StaleObservationError
from agent_node.shelf import PolicyShelf
from agent_node.steps import StepMatcher
from pa_ros.acting.config import ActingConfig, Schedule
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.core.experience import PolicySnapshot
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor
from pa_ros.wire.records import PublishedPolicy

DESIGN = design_named("2-L")
NETWORK = NetworkConfig(vocabulary=DESIGN.vocabulary, hidden=8, attention=4)
ALONE = ActingConfig(schedule=Schedule(trajectory_steps=10, policy_lag=10**6))
SYNCHRONOUS = ActingConfig(schedule=Schedule(trajectory_steps=10, policy_lag=1))


def published(version: int, consumed: dict[str, int] | None = None, run: str = "run"):
    tensors = initial_actor(NETWORK, np.random.default_rng(version))
    digest = DESIGN.vocabulary.digest
    snapshot = PolicySnapshot(version, NETWORK.architecture, digest, tensors)
    return PublishedPolicy(snapshot, run, consumed or {})


class Arm:
    """An arena that does as the driver says, unless told otherwise."""

    def __init__(self, driver: LearningDriver) -> None:
        self.driver = driver
        self.task = ReachTask(preset_named("fast"), DESIGN, seed=1)
        self.sent = []
        self.velocity = np.zeros(6)

    def show(self, observation, verdict, by="me", evaluation=False) -> None:
        step = Step(
            observation, self.task.program, evaluation, by, verdict, ends_episode=verdict.truncated
        )
        outgoing = self.driver.observe(step)
        if outgoing is not None:
            self.sent.append(outgoing)
        action = self.driver.act()
        self.velocity = np.zeros(6) if action is None else action.astype(np.float64)

    def reset(self, episode: int, evaluation: bool = False) -> None:
        condition = "eval" if evaluation else "train"
        self.show(*self.task.reset(episode, condition), by="", evaluation=evaluation)

    def run(self, steps: int, by: str = "me", evaluation: bool = False) -> None:
        for _ in range(steps):
            self.show(*self.task.step(self.velocity), by=by, evaluation=evaluation)


@pytest.fixture
def arm() -> Arm:
    driver = LearningDriver("me", ALONE, seed=0)
    driver.offer(published(0))
    driver.meet(0.1)
    return Arm(driver)


def spans(arm: Arm) -> list[tuple[int, int, int]]:
    """(sequence, first step, length) of the trajectories sent."""
    return [(o.trajectory.sequence, o.trajectory.first_step, len(o.trajectory)) for o in arm.sent]


def test_trajectories_follow_one_another_without_gap(arm):
    arm.reset(0)
    arm.run(25)
    assert spans(arm) == [(0, 0, 10), (1, 10, 10)]
    assert [o.stamp_ns for o in arm.sent] == [100_000_000, 1_100_000_000]


def test_a_reset_cuts_the_trajectory_and_nothing_crosses_it(arm):
    arm.reset(0)
    arm.run(7)
    arm.reset(5)
    arm.run(10)
    assert spans(arm) == [(0, 0, 7), (1, 0, 10)]
    assert [o.trajectory.episode for o in arm.sent] == [0, 5]
    assert arm.sent[0].trajectory.ends_episode and not arm.sent[1].trajectory.ends_episode


def test_a_change_of_program_cuts_the_trajectory_and_nothing_crosses_it(arm):
    arm.reset(0)
    arm.run(4)
    before = arm.task.program
    kinds = [block.kind for block in arm.task.episode.blocks]
    other = next(k for k in kinds if k.color not in before or k.shape not in before)
    arm.task.set_program(f"NEAR(HAND, AND({other.color}, {other.shape}))")
    arm.run(11)
    assert spans(arm) == [(0, 0, 4), (1, 5, 10)]  # 4 to 5 crosses: left out
    assert [o.trajectory.program for o in arm.sent] == [before, arm.task.program]


def test_what_another_hand_did_is_not_experience(arm):
    arm.reset(0)
    arm.run(10)
    arm.run(3)
    arm.run(1, by="")  # the watchdog held, or the command was clamped
    arm.run(2, by="someone")
    arm.run(10)
    assert spans(arm) == [(0, 0, 10), (1, 16, 10)]
    assert arm.driver.interrupted == 3


def test_evaluation_episodes_leave_no_trace(arm):
    arm.reset(0)
    arm.run(20)
    other = Arm(LearningDriver("me", ALONE, seed=0))
    other.driver.offer(published(0))
    other.driver.meet(0.1)
    other.reset(0)
    other.run(10)
    other.run(10)
    arm.reset(1)
    arm.run(20)
    other.reset(0, evaluation=True)
    other.run(30, evaluation=True)
    other.reset(1)
    other.run(20)
    assert spans(arm) == spans(other)
    for a, b in zip(arm.sent, other.sent, strict=True):
        assert np.array_equal(a.trajectory.objects, b.trajectory.objects)
        assert np.array_equal(a.trajectory.actions, b.trajectory.actions)


def test_evaluation_is_greedy_and_training_is_not(arm):
    arm.reset(0, evaluation=True)
    greedy = GreedyDriver(published(0).snapshot)
    observation, verdict = arm.task.reset(0, "eval")
    arm.show(observation, verdict, by="", evaluation=True)
    greedy.observe(Step(observation, arm.task.program, True, "", None, ends_episode=False))
    assert np.array_equal(arm.velocity, greedy.act().astype(np.float64))
    arm.show(observation, verdict, by="")
    assert np.abs(arm.velocity).max() > 0.05


def test_each_trajectory_acts_with_the_version_the_protocol_names():
    driver = LearningDriver("me", SYNCHRONOUS, seed=0)
    driver.offer(published(0))
    driver.meet(0.1)
    arm = Arm(driver)
    arm.reset(0)
    arm.run(10)
    assert driver.version == 0
    arm.run(10)  # trajectory 1 acts with version 0 too
    assert driver.waiting and driver.act() is None
    driver.offer(published(1, {"me": 0}))
    driver.offer(published(2, {"me": 1}))  # newer, and not what trajectory 2 must act with
    assert driver.act() is not None and driver.version == 1
    arm.velocity = np.zeros(6)
    arm.run(10)
    assert driver.version == 2
    assert [o.trajectory.policy_version for o in arm.sent] == [0, 0, 1]


def test_with_other_agents_versions_grow_faster_and_nobody_waits_for_ever():
    shelf = PolicyShelf("me")
    for version, consumed in ((0, {}), (1, {"you": 0}), (2, {"you": 1}), (3, {"you": 1, "me": 0})):
        shelf.add(published(version, consumed), sent=1)
    assert shelf.for_trajectory(1, lag=1).snapshot.version == 0
    assert shelf.for_trajectory(2, lag=1).snapshot.version == 3
    assert shelf.for_trajectory(3, lag=1) is None


@pytest.mark.parametrize("after", [published(4, {"me": 3}), published(9, {}, run="another")])
def test_a_learner_that_lost_trajectories_is_not_waited_for(after):
    shelf = PolicyShelf("me")
    shelf.add(published(6, {"me": 5}), sent=7)
    assert shelf.for_trajectory(8, lag=1) is None
    shelf.add(after, sent=8)
    assert shelf.for_trajectory(8, lag=1) is not None


def test_a_refused_trajectory_is_accounted_for_without_a_new_version():
    shelf = PolicyShelf("me")
    shelf.add(published(3, {"me": 2}), sent=4)
    assert shelf.for_trajectory(4, lag=0) is None
    shelf.add(published(3, {"me": 3}), sent=4)
    assert shelf.for_trajectory(4, lag=0).snapshot.version == 3


def test_steps_are_matched_by_stamp_in_any_order_and_old_ones_refused():
    matcher = StepMatcher(("a", "b"))
    assert matcher.add("b", 10, "b10") is None
    assert matcher.add("a", 20, "a20") is None
    assert matcher.add("a", 10, "a10") == {"a": "a10", "b": "b10"}
    assert matcher.add("b", 20, "b20") == {"a": "a20", "b": "b20"}
    with pytest.raises(StaleObservationError, match="20"):
        matcher.add("a", 10, "again")
    assert matcher.add("a", 20, "a20") is None  # the newest may come again
    assert matcher.add("b", 20, "b20") is not None
    for stamp in range(30, 60):
        matcher.add("a", stamp, "lonely")  # the other parts never come: memory stays bounded
    assert matcher.add("b", 31, "b31") is None  # forgotten
    assert matcher.add("b", 59, "b59") == {"a": "lonely", "b": "b59"}
    matcher.restart()
    assert matcher.add("a", 1, "a") is None and matcher.add("b", 1, "b") is not None
