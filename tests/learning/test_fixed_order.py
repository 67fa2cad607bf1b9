"""Several agents in step: exact (in turn, whatever comes first) and free (nobody waits)."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import pytest

from helpers.learners import DESIGN, WORLD, trajectory
from pa_ros.arena import training_programs
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import TrajectoryKey
from pa_ros.learning.errors import LearningError
from pa_ros.learning.fixed_order import FixedOrder, in_fixed_order
from pa_ros.learning.learner import Learner
from pa_ros.learning.protocols import LearningSettings
from pa_ros.learning.run import LearningRun
from pa_ros.world import Trajectory

SMALL: dict[str, Any] = {
    "learner.replay.warmup_frames": 0,
    "learner.replay.batch_size": 4,
    "network.hidden": 8,
    "network.attention": 4,
}
EVERY = [trajectory(m, agent) for m, agent in itertools.product(range(2), "ab")]


def run_of(**settings: Any) -> LearningRun:
    learning = LearningSettings().changed(**SMALL | settings)
    network = learning.network.for_world(WORLD)
    learner = Learner(network, learning.learner, training_programs(DESIGN), seed=0)
    return LearningRun(learner, 0.1)


<<<<<<< HEAD:tests/learning/test_turns.py
def taken_in(order: tuple[Trajectory, ...], agents: str = "ab") -> list[tuple[str, int]]:
    """What a learner with turns learns from, in its order, of what comes in another."""
    run, learned = run_of(**{"learner.schedule.in_step": "exact"}), []
    turns = Turns(run, agents)
    for one in order:
        for ready in turns.ready(one):
=======
def learned_from(arrivals: tuple[Trajectory, ...], agents: str = "ab") -> list[tuple[str, int]]:
    """Agent and number of the trajectories that a learner with a fixed order learns from."""
    run, learned = run_of("learner.schedule.in_step=exact"), []
    order = FixedOrder(run, agents)
    for one in arrivals:
        for ready in order.ready(one):
>>>>>>> 5c63544 (refactor(learning): a trajectory is checked once; SequenceTracker, GoalMasks, FixedOrder):tests/learning/test_fixed_order.py
            run.consume(ready)
            learned.append((ready.agent_id, ready.sequence))
    assert len(order) + len(learned) == len({one.key for one in arrivals})
    return learned


@pytest.mark.parametrize("arrivals", list(itertools.permutations(EVERY)))
def test_trajectories_are_learned_from_in_a_fixed_order_however_they_arrive(arrivals):
    assert learned_from(arrivals) == [("a", 0), ("b", 0), ("a", 1), ("b", 1)]


def test_a_missing_trajectory_is_waited_for_and_named_by_its_agent():
<<<<<<< HEAD:tests/learning/test_turns.py
    run = run_of(**{"learner.schedule.in_step": "exact"})
    turns = Turns(run, ("a", "b"))
    assert turns.awaited == ""
    assert list(turns.ready(trajectory(0, "b"))) == []
    assert turns.awaited == "a" and len(turns) == 1
    assert list(turns.ready(trajectory(1, "a"))) == []  # its first is on its way
    assert turns.awaited == "a"


def test_who_has_no_turn_and_who_was_superseded_is_refused():
    run = run_of(**{"learner.schedule.in_step": "exact"})
    turns = Turns(run, ("a", "b"))
=======
    run = run_of("learner.schedule.in_step=exact")
    order = FixedOrder(run, ("a", "b"))
    assert order.awaited == ""
    assert list(order.ready(trajectory(0, "b"))) == []
    assert order.awaited == "a" and len(order) == 1
    assert list(order.ready(trajectory(1, "a"))) == []  # its first is on its way
    assert order.awaited == "a"


def test_who_has_no_turn_and_who_was_superseded_is_refused():
    run = run_of("learner.schedule.in_step=exact")
    order = FixedOrder(run, ("a", "b"))
>>>>>>> 5c63544 (refactor(learning): a trajectory is checked once; SequenceTracker, GoalMasks, FixedOrder):tests/learning/test_fixed_order.py
    with pytest.raises(
        LearningError, match=r"expected one of the agents \['a', 'b'\].*got one of 'c'"
    ):
        list(order.ready(trajectory(0, "c")))
    for one in order.ready(replace(trajectory(0, "a"), incarnation=1)):
        run.consume(one)
    with pytest.raises(LearningError):
        list(order.ready(trajectory(1, "a")))


def test_an_agent_that_starts_again_takes_its_turn_with_what_it_sends_now():
<<<<<<< HEAD:tests/learning/test_turns.py
    run = run_of(**{"learner.schedule.in_step": "exact"})
    turns = Turns(run, ("a", "b"))
    assert list(turns.ready(trajectory(0, "b"))) == []
    assert list(turns.ready(replace(trajectory(0, "b"), incarnation=1))) == []
=======
    run = run_of("learner.schedule.in_step=exact")
    order = FixedOrder(run, ("a", "b"))
    assert list(order.ready(trajectory(0, "b"))) == []
    assert list(order.ready(replace(trajectory(0, "b"), incarnation=1))) == []
>>>>>>> 5c63544 (refactor(learning): a trajectory is checked once; SequenceTracker, GoalMasks, FixedOrder):tests/learning/test_fixed_order.py
    ready = []
    for one in order.ready(trajectory(0, "a")):
        run.consume(one)
        ready.append((one.agent_id, one.incarnation))
    assert ready == [("a", 0), ("b", 1)] and len(order) == 0


def test_keys_are_put_in_turn_from_a_version_on():
    keys = [TrajectoryKey(agent, 0, m) for agent in "ab" for m in range(2)]
    assert [(k.agent_id, k.sequence) for k in in_fixed_order(keys, "ab", 0)] == [
        ("a", 0), ("b", 0), ("a", 1), ("b", 1),
    ]  # fmt: skip
    assert [k.agent_id for k in in_fixed_order(keys, "ab", 3)] == ["b", "a", "b", "a"]
    assert in_fixed_order(keys[:1], "ab", 1) == []


def test_free_agents_are_not_to_wait_and_what_too_old_weights_did_is_counted_and_refused():
    run = run_of(**{"learner.schedule.in_step": "free", "learner.schedule.oldest_policy": 2})
    assert run.info.free
    ours = [replace(trajectory(m), run_id=run.info.run_id) for m in range(6)]
    for one in ours[:3]:
        run.consume(one)
    with pytest.raises(LearningError, match="at most schedule.oldest_policy = 2 versions before 3"):
        run.consume(ours[3])
    figures = run.learner.metrics()
    assert figures["too_old_trajectories"] == 1 and figures["frames"] == 30
    assert run.policy().accounted == {ours[0].agent: 4}  # it is not waited for, nor sent again
    run.consume(ours[3])  # a duplicate is only that
    assert run.learner.metrics()["too_old_trajectories"] == 1
    run.consume(replace(ours[4], policy_version=1))
    assert run.learner.metrics()["frames"] == 40


def test_others_are_told_to_wait_however_old_their_weights():
    run = run_of(**{"learner.schedule.oldest_policy": 0})
    assert not run.info.free and run.info.policy_lag == 1
    for m in range(3):
        run.consume(replace(trajectory(m), run_id=run.info.run_id))
    assert run.learner.metrics()["frames"] == 30


def test_an_unknown_way_is_refused():
    with pytest.raises(ConfigError, match="in_step: expected one of .*'free'.*, got 'both'"):
        run_of(**{"learner.schedule.in_step": "both"})
