"""Which weights an agent acts with, and which steps it joins to experience."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.learners import (
    ARENA,
    DESIGN,
    FACTS,
    FAR_BEHIND,
    LEARNER,
    ME,
    WORLD,
    Arm,
    Says,
    again,
    following,
    published,
    snapshot,
)
from helpers.rejections import rejected
from pa_ros.acting.agent import Agent
from pa_ros.acting.errors import ActingError
from pa_ros.acting.learning_agent import LearningAgent
from pa_ros.acting.send_window import Wait
from pa_ros.core.experience import PERSON, Executed, PublishedPolicy, Step
from pa_ros.language import PRODUCT, parse
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError


def _of(sent: Executed, **fields: Any) -> Executed:
    return Executed(sent.command._replace(**fields), sent.action)


@pytest.fixture
def arm() -> Arm:
    return Arm(following())


def test_a_greedy_agent_knows_its_first_weights_before_its_first_step() -> None:
    """Who waits for it to be ready must see that it is, before there is a program to act on."""
    agent = Agent(ME)
    assert not agent.has_weights
    with pytest.raises(ActingError, match="expected weights"):
        _ = agent.version
    agent.follow(LEARNER, FACTS)
    agent.offer(published(3))
    assert agent.has_weights and agent.version == 3


def test_trajectories_follow_one_another_without_gap(arm) -> None:
    arm.reset(0)
    arm.run(25)
    assert arm.spans == [(0, 0, 10), (1, 10, 10)]
    assert [one.stamp_ns for one in arm.sent] == [100_000_000, 1_100_000_000]
    assert {(one.agent, one.run_id) for one in arm.sent} == {(ME, "run")}


NOT_MINE: dict[str, Says] = {
    "nobody's": lambda sent: None,  # the watchdog held, or the command was clamped
    "another agent's": lambda sent: _of(sent, agent_id="someone"),
    "an earlier one of mine": lambda sent: _of(sent, number=sent.command.number - 1),
}


@pytest.mark.parametrize("says", NOT_MINE.values(), ids=NOT_MINE)
def test_steps_after_anothers_command_are_no_experience(arm, says) -> None:
    arm.reset(0)
    arm.run(10)
    arm.run(3)
    arm.run(3, says)
    arm.run(10)
    assert arm.spans == [(0, 0, 10), (1, 10, 3), (2, 16, 10)]
    assert arm.agent.interrupted == 3


@pytest.mark.parametrize("moved_by", [ME.agent_id, PERSON])
def test_what_the_arm_did_is_learned_from_and_not_what_was_asked_for(arm, moved_by) -> None:
    slower = lambda sent: Executed(  # noqa: E731
        sent.command._replace(agent_id=moved_by), sent.action * np.float32(0.5)
    )
    arm.reset(0)
    asked = []
    for _ in range(10):
        asked.append(arm.agent.last_command.action)
        arm.run(1, slower)
    assert arm.spans == [(0, 0, 10)] and arm.agent.interrupted == 0
    assert arm.sent[0].actions == pytest.approx(np.array(asked) * 0.5)


def test_commands_are_numbered_and_a_held_step_is_no_experience(arm) -> None:
    arm.reset(0)
    arm.run(3)
    assert arm.agent.last_command.command == (*ME, 4)
    observation, verdict = arm.task.step(arm.velocity)
    step = Step(observation, verdict, executed=arm.agent.last_command)
    arm.agent.observe(step, arm.task.program)
    arm.velocity = arm.agent.hold()
    assert not arm.velocity.any() and arm.agent.last_command.command == (*ME, 5)
    arm.run(11)
    assert arm.spans == [(0, 0, 4), (1, 5, 10)]


def test_a_program_that_the_networks_cannot_represent_is_rejected_early() -> None:
    network = NetworkConfig(world=WORLD, family="canonical", canonical_hidden=4)
    agent, either = Agent(ME), parse("NEAR(HAND, RED)", DESIGN.vocabulary)
    agent.check_program(either)  # before there are weights nothing can be said
    agent.offer(PublishedPolicy(snapshot(0, network), "run", "learner"))
    agent.check_program(parse("NEAR(HAND, AND(RED, CUBE))", DESIGN.vocabulary))
    with pytest.raises(NetworkError):
        agent.check_program(either)


def test_a_greedy_agent_uses_the_followed_learners_weights_whatever_arrived_first() -> None:
    other = NetworkConfig(world=WORLD, hidden=4, attention=2)
    agent = Agent(ME)
    agent.offer(PublishedPolicy(snapshot(9, other), "strange", "stranger"))
    with pytest.raises(ActingError, match="expected architecture"):
        agent.offer(published(1))  # nothing says yet whose weights these should be
    agent.follow(LEARNER, FACTS)
    assert agent.version == 1  # it was kept
    with pytest.raises(ActingError, match="'learner', got version 10 of 'stranger'"):
        agent.offer(PublishedPolicy(snapshot(10, other), "strange", "stranger"))
    agent.offer(published(2))
    assert agent.version == 2
    with pytest.raises(ActingError, match="world_digest"):
        agent.follow(again(LEARNER, 4, world_digest="f" * 16), FACTS)
    agent.offer(published(4))
    assert agent.version == 4


def test_evaluation_episodes_leave_no_trace(arm) -> None:
    arm.reset(0)
    arm.run(20)
    other = Arm(following())
    other.reset(0)
    other.run(20)
    arm.reset(1)
    arm.run(20)
    other.reset(0, evaluation=True)
    other.run(30, evaluation=True)
    other.reset(1)
    other.run(20)
    assert arm.spans == other.spans
    for a, b in zip(arm.sent, other.sent, strict=True):
        assert np.array_equal(a.objects, b.objects)
        assert np.array_equal(a.actions, b.actions)


def test_evaluation_is_greedy_and_training_is_not(arm) -> None:
    greedy = Arm(Agent(ME, PRODUCT))  # as who learns acts
    greedy.agent.offer(published(0))
    for one in (arm, greedy):
        one.reset(0, evaluation=True)
    assert np.array_equal(arm.velocity, greedy.velocity) and greedy.velocity.any()
    arm.reset(0)
    greedy.reset(0)
    assert np.abs(arm.velocity - greedy.velocity).max() > 0.05


def test_each_trajectory_acts_with_the_version_the_protocol_names() -> None:
    arm = Arm(following(LEARNER))
    agent = arm.agent
    arm.reset(0)
    arm.run(10)
    assert agent.version == 0
    arm.run(10)  # trajectory 1 acts with version 0 too
    assert agent.waiting and agent.prepare() is not None
    expected = r"^action: expected prepare\(\) to return None before it, got"
    with pytest.raises(ActingError, match=f"{expected} weights that account"):
        agent.act()
    agent.offer(published(1, mine=1))
    agent.offer(published(2, mine=2))  # newer, and not what trajectory 2 must act with
    with pytest.raises(ActingError, match=f"{expected} no call of it at this step$"):
        agent.act()
    assert agent.prepare() is None and agent.version == 1
    assert agent.prepare() is None and agent.version == 1  # asking again changes nothing
    agent.act()
    with pytest.raises(ActingError, match="a step to act on"):
        agent.act()
    arm.run(10)
    assert agent.version == 2
    assert [one.policy_version for one in arm.sent] == [0, 0, 1]


def test_a_learning_agent_makes_no_transition_of_a_step_that_nobody_judged(arm) -> None:
    arm.reset(0)
    arm.run(3)
    observation, verdict = arm.task.step(arm.velocity)
    judged = Step(observation, verdict, executed=arm.agent.last_command)
    with rejected("learning.unjudged", match="since this agent learns, got one without a reward"):
        arm.agent.observe(replace(judged, verdict=None), arm.task.program)
    assert not arm.agent.waiting and arm.spans == []
    arm.agent.observe(replace(judged, verdict=None, evaluation=True), arm.task.program)
    assert arm.agent.waiting


def test_no_action_follows_an_episodes_last_step(arm) -> None:
    arm.reset(0)
    arm.run(ARENA.episode_steps - 1)
    assert arm.velocity.any()
    arm.run(1)
    assert not arm.agent.waiting and not arm.velocity.any()


def test_a_step_that_arrived_before_the_learner_is_not_lost() -> None:
    agent = LearningAgent(ME, seed=0)
    arm = Arm(agent)
    arm.reset(0)
    assert agent.prepare() == Wait("a learner to announce itself")
    agent.offer(published(0, learner=FAR_BEHIND))  # the two topics are not in order
    agent.follow(FAR_BEHIND, FACTS)
    assert agent.prepare() is None
    arm.velocity = agent.act().astype(np.float64)
    arm.run(10)
    assert arm.spans == [(0, 0, 10)]


def test_trajectories_in_flight_are_sent_again_to_a_resumed_learner() -> None:
    arm = Arm(following(LEARNER))
    arm.reset(0)
    arm.run(10)
    arm.agent.offer(published(1, mine=1))
    arm.run(20)
    assert [one.sequence for one in arm.agent.unaccounted] == [1, 2]
    resumed = again(LEARNER, version=1)
    arm.agent.offer(published(0, learner=resumed))
    arm.agent.follow(resumed, FACTS)
    arm.agent.offer(published(1, mine=1, learner=resumed))
    assert [(o.sequence, o.held_from) for o in arm.agent.unaccounted] == [(1, 1), (2, 1)]
    assert isinstance(arm.agent.required(), Wait) and arm.agent.lost == 0
    arm.agent.offer(published(2, mine=2))  # of the learner that is gone
    assert isinstance(arm.agent.required(), Wait)
    arm.agent.offer(published(2, mine=2, learner=resumed))
    assert arm.agent.prepare() is None
    assert arm.agent.interrupted == 0


def test_an_agent_whose_numbers_someone_else_used_up_continues_as_another_start() -> None:
    arm = Arm(following(LEARNER))
    arm.reset(0)
    arm.run(14)
    arm.agent.offer(published(1, mine=10**6))
    arm.run(12)
    keys = [(one.incarnation, one.sequence, one.first_of_run) for one in arm.sent]
    assert keys == [(ME.incarnation, 0, 0), (ME.incarnation + 1, 1, 1)]
    assert arm.agent.interrupted == 1 and not arm.agent.waiting


def test_in_another_arena_an_agent_keeps_the_weights_of_its_learner() -> None:
    arm = Arm(following(LEARNER))
    arm.reset(0)
    arm.run(10)
    arm.agent.offer(published(1, mine=1))
    arm.run(10)
    arm.agent.follow(LEARNER, FACTS)  # the arena has restarted
    arm.reset(1)
    arm.run(10)
    assert len(arm.sent) == 3 and arm.agent.version == 1


def test_another_run_gets_no_trajectories_of_the_one_before(arm) -> None:
    arm.reset(0)
    arm.run(14)
    another = again(FAR_BEHIND, version=0, run_id="another")
    arm.agent.follow(another, FACTS)
    assert arm.agent.unaccounted == [] and arm.agent.interrupted == 1
    arm.agent.offer(published(0, learner=another))
    arm.run(12)
    assert arm.spans == [(0, 0, 10), (1, 15, 10)]  # numbers go on, and 14 was acted by the other
    numbers = [(o.run_id, o.first_of_run, o.held_from) for o in arm.sent]
    assert numbers == [("run", 0, 0), ("another", 1, 1)]


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("world_digest", "0" * 16, "world_digest: expected .*arena's, got '0000"),
        ("thresholds", (0.1,), r"thresholds: expected \(0.2,\), as this arena's, got \(0.1,\)"),
        ("inference", "tpu", "inference: expected 'auto' or 'torch', got 'tpu'"),
        ("architecture", "{}", "learner_info.architecture: "),
        ("exploration", '{"process":"white"}', "learner_info.exploration: .*process"),
    ],
)
def test_an_agent_that_cannot_do_as_asked_says_why_and_does_not_act(field, value, message) -> None:
    agent = LearningAgent(ME, seed=0)
    with pytest.raises(ActingError, match=message):
        agent.follow(replace(LEARNER, **{field: value}), FACTS)
    agent.offer(published(0))
    arm = Arm(agent)
    arm.reset(0)
    assert not arm.velocity.any() and field in agent.rejection
    waits = agent.required()
    assert isinstance(waits, Wait) and agent.rejection in waits.reason
    agent.follow(again(LEARNER, version=0), FACTS)  # one that it can act for
    agent.offer(published(0, learner=again(LEARNER, version=0)))
    assert agent.rejection == "" and agent.prepare() is None


def test_an_arena_of_other_facts_stops_an_agent_that_acted_but_a_strange_learner_does_not(arm):
    arm.reset(0)
    with pytest.raises(ActingError, match="thresholds"):
        arm.agent.follow(again(FAR_BEHIND, 0, thresholds=(9.0,)), FACTS)
    arm.run(10)
    assert arm.spans == [(0, 0, 10)]
    slower = FACTS._replace(control_period=0.5)
    with pytest.raises(ActingError, match="control_period"):
        arm.agent.follow(FAR_BEHIND, slower)
    arm.run(1)
    assert isinstance(arm.agent.required(), Wait) and not arm.velocity.any()
    arm.agent.follow(FAR_BEHIND, FACTS)
    arm.run(1)
    assert arm.velocity.any()
