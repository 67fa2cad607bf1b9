"""Several agents: learned from in a fixed order (exact), or without anyone waiting (free)."""

import itertools
from dataclasses import replace
from typing import Any

import pytest

from helpers.learners import DESIGN, WORLD, small, trajectory
from pa_ros.arena import training_programs
from pa_ros.core.experience import TrajectoryKey
from pa_ros.learning.errors import LearningError
from pa_ros.learning.fixed_order import FixedOrder, in_fixed_order
from pa_ros.learning.learner import Learner
from pa_ros.learning.recipes import LearningSettings
from pa_ros.learning.run import AHEAD, LearningRun
from pa_ros.world import Trajectory

SMALL = small(0, 4, 8, attention=4)
EVERY = [trajectory(m, agent) for m, agent in itertools.product(range(2), "ab")]


def run_of(in_step: str, **schedule: Any) -> LearningRun:
    schedule = {f"learner.schedule.{name}": value for name, value in schedule.items()}
    settings = SMALL | schedule | {"learner.schedule.in_step": in_step}
    learning = LearningSettings().changed(**settings)
    network = learning.network.for_world(WORLD)
    return LearningRun(Learner(network, learning.learner, training_programs(DESIGN), seed=0), 0.1)


def learned_from(
    arrivals: tuple[Trajectory, ...], run: LearningRun, order: FixedOrder
) -> list[tuple[str, int, int]]:
    """Agent, incarnation and number of the trajectories that a learner learns from, in order."""
    learned = []
    for one in arrivals:
        for ready in order.ready(one):
            run.consume(ready)
            learned.append((ready.agent_id, ready.incarnation, ready.sequence))
    return learned


@pytest.mark.parametrize("arrivals", list(itertools.permutations(EVERY)))
def test_trajectories_are_learned_from_in_a_fixed_order_however_they_arrive(arrivals):
    run = run_of("exact")
    learned = learned_from(arrivals, run, FixedOrder(run, ("a", "b")))
    assert learned == [("a", 0, 0), ("b", 0, 0), ("a", 0, 1), ("b", 0, 1)]


def test_without_an_order_each_trajectory_is_learned_from_as_it_arrives():
    run, arrivals = run_of("exact"), (trajectory(1, "b"), trajectory(0, "a"), trajectory(0, "b"))
    learned = learned_from(arrivals, run, FixedOrder(run))
    assert learned == [("b", 0, 1), ("a", 0, 0), ("b", 0, 0)]


def test_a_missing_trajectory_is_waited_for_and_named_by_its_agent():
    order = FixedOrder(run_of("exact"), ("a", "b"))
    assert order.awaited == ""
    assert list(order.ready(trajectory(0, "b"))) == []
    assert order.awaited == "a" and len(order) == 1
    assert list(order.ready(trajectory(1, "a"))) == []  # its first is still under way
    assert order.awaited == "a"


def test_a_working_agent_is_no_farther_ahead_than_it_can_be() -> None:
    run = run_of("arrival", policy_lag=3)
    run.check_sender(trajectory(0))
    run.check_sender(replace(trajectory(AHEAD + 3), held_from=9))
    with pytest.raises(LearningError, match=f"at most number {AHEAD + 3} of 'a', got {AHEAD + 4}:"):
        run.check_sender(replace(trajectory(AHEAD + 4), held_from=9))


def test_an_agent_without_a_place_is_rejected():
    order = FixedOrder(run_of("exact"), ("a", "b"))
    with pytest.raises(LearningError, match=r"expected one of .*\['a', 'b'\].*got one of 'c'"):
        list(order.ready(trajectory(0, "c")))


def test_a_restarted_agent_keeps_its_place_with_its_new_trajectories():
    run = run_of("exact")
    arrivals = trajectory(0, "b"), replace(trajectory(0, "b"), incarnation=1), trajectory(0, "a")
    order = FixedOrder(run, ("a", "b"))
    assert learned_from(arrivals, run, order) == [("a", 0, 0), ("b", 1, 0)] and len(order) == 0


def test_keys_are_ordered_from_a_version_on():
    keys = [TrajectoryKey(agent, 0, m) for agent in "ab" for m in range(2)]
    assert [(k.agent_id, k.sequence) for k in in_fixed_order(keys, "ab", 0)] == [
        ("a", 0), ("b", 0), ("a", 1), ("b", 1),
    ]  # fmt: skip
    assert [k.agent_id for k in in_fixed_order(keys, "ab", 3)] == ["b", "a", "b", "a"]
    assert in_fixed_order(keys[:1], "ab", 1) == []


def test_free_agents_never_wait_and_what_too_old_weights_did_is_rejected_and_counted():
    run = run_of("free", oldest_policy=2)
    assert run.info.free
    ours = [replace(trajectory(m), run_id=run.info.run_id) for m in range(6)]
    for one in ours[:3]:
        run.consume(one)
    with pytest.raises(LearningError, match="at most schedule.oldest_policy = 2 versions before 3"):
        run.consume(ours[3])
    figures = run.learner.metrics()
    assert figures["rejected_trajectories"] == 1 and figures["frames"] == 30
    assert run.policy().accounted == {ours[0].agent: 4}  # nobody waits for it or sends it again
    run.consume(ours[3])  # a duplicate is not counted as too old
    assert run.learner.metrics()["rejected_trajectories"] == 1
    run.consume(replace(ours[4], policy_version=1))
    assert run.learner.metrics()["frames"] == 40
