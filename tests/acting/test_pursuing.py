"""Which program of a goal over time an agent pursues: by the verifier, or by its own judgement."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from helpers.learners import ME, WORDS, Arm, following
from helpers.messages import judged
from helpers.rejections import rejected
from pa_ros.acting.agent import Agent
from pa_ros.acting.executing import Actor
from pa_ros.acting.execution import ExecutionWatch, window_s
from pa_ros.agents import load_agent
from pa_ros.arena import ReachTask, design_named, preset_named, scripted_action
from pa_ros.core.experience import PublishedPolicy, Step
from pa_ros.language import parse, parse_goal, stages
from pa_ros.learning.checkpoints import load_policy

FAST, DESIGN = preset_named("fast"), design_named("3-D")


@pytest.fixture
def task() -> ReachTask:
    return ReachTask(FAST, DESIGN, seed=1)


@pytest.fixture
def agent() -> Agent:
    agent = Agent(ME)
    agent.offer(PublishedPolicy(load_policy(Path("shipped:3-D")), ""))
    return agent


@pytest.mark.parametrize("heard", [True, False], ids=["verifier", "own judgement"])
def test_a_trained_agent_executes_a_chain(task: ReachTask, agent: Agent, heard: bool) -> None:
    """Its own judgement leads to the same programs as the verifier's."""
    observation, verdict = task.reset(0, "chain-2")
    while not verdict.satisfied and not verdict.truncated:
        step = Step(observation, verdict if heard else None, str(task.goal))
        agent.observe(step, task.goal)
        assert agent.prepare() is None
        action = agent.act()
        assert agent.pursued(step, task.goal) == task.program
        own = agent.verdict(step, task.goal)
        assert own is not None
        assert (own.stage, own.satisfied) == (verdict.stage, verdict.satisfied)
        assert own.distance == pytest.approx(verdict.distance)
        observation, verdict = task.step(action * np.array(FAST.joint_speed_limits))
    assert verdict.satisfied


def test_the_shipped_agent_goes_around_what_it_is_to_avoid() -> None:
    task = ReachTask(FAST, design_named("3-D-avoid"), seed=1)
    actor = Actor.of(load_policy(Path("shipped:avoid")))
    for episode in range(5):
        observation, verdict = task.reset(episode, "avoid-or")
        while not (verdict.satisfied or verdict.truncated):
            action = actor.act(observation, task.program)
            observation, verdict = task.step(action * np.array(FAST.joint_speed_limits))
            assert not verdict.violated
        assert verdict.satisfied


def test_own_judgement_begins_again_with_another_episode(task: ReachTask, agent: Agent) -> None:
    start, verdict = task.reset(0, "chain-2")
    goal, near = task.goal, start
    while not verdict.stage:
        near, verdict = task.step(scripted_action(task))
    agent.observe(Step(start), goal)
    assert agent.prepare() is None
    for observation, stage in ((start, 0), (near, 1), (start, 1), (replace(start, episode=9), 0)):
        own = agent.verdict(Step(replace(observation, stamp_ns=start.stamp_ns + stage)), goal)
        assert own is not None and own.stage == stage


def test_of_several_blocks_the_hand_goes_to_the_nearest(task: ReachTask) -> None:
    """The networks are not shown the others that the program names, but what else there is."""
    actor = Actor.of(load_policy(Path("shipped:3-D")))
    for episode in range(10):
        observation, _ = task.reset(episode, "several-2")
        blocks, hand = observation.objects[:, :3], observation.hand_index
        away = np.linalg.norm(blocks - blocks[hand], axis=1)
        near, far = sorted(task.verifier.targets, key=lambda i: float(away[i]))
        acted = actor.act(observation, task.program)
        for absent, same in ((far, True), (near, False)):
            fewer = replace(observation, objects=np.delete(observation.objects, absent, 0))
            assert np.array_equal(actor.act(fewer, task.program), acted) == same


def test_of_several_blocks_and_places_the_two_nearest_to_each_other_are_brought_together() -> None:
    task = ReachTask(preset_named("push"), design_named("push-3D"), seed=1)
    actor = Actor.of(load_policy(Path("shipped:push")))
    program = parse("NEAR(NOT(PLACE), PLACE)", task.world.vocabulary)
    for episode in range(5):
        observation, _ = task.reset(episode, "eval")
        objects, (*_, one, other) = observation.objects, range(len(observation.objects))
        away = np.linalg.norm(objects[1:one, None, :3] - objects[None, one:, :3], axis=-1)
        block, place = np.unravel_index(away.argmin(), away.shape)
        alone = replace(observation, objects=objects[[0, 1 + block, (one, other)[place]]])
        assert np.array_equal(actor.act(observation, program), actor.act(alone, program))


def test_a_nearer_block_about_which_the_agent_is_undecided_is_not_gone_for() -> None:
    """A property that training never showed has half a degree."""
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=3)
    actor, undecided = Actor.of(load_policy(Path("shipped:2-L"))), 0
    for episode in range(20):
        observation, _ = task.reset(episode, "ignore-new")
        p = np.delete(actor.relevance(observation, task.program), observation.hand_index)
        never = parse("NEAR(HAND, AND(RED, NOT(RED)))", task.world.vocabulary)
        assert actor.judge(observation, task.scoring)(never).measure < np.inf
        if np.sum((p >= 0.5 * p.max()) & (p < 0.75 * p.max())):
            undecided += 1
            np.testing.assert_array_equal(
                actor.act(observation, task.program), actor.infer(observation, task.program)
            )
    assert undecided > 2


def test_a_block_is_moved_slower_as_it_comes_to_its_place() -> None:
    task = ReachTask(preset_named("push"), design_named("push-3D"), seed=1)
    agent, slow, still = load_agent("shipped:push"), 0, 0
    actor = Actor.of(agent.snapshot)
    for episode in range(3):
        observation, verdict = task.reset(episode, "eval")
        while not verdict.truncated:
            full = actor.infer(observation, task.program)
            part = actor.act(observation, task.program) / full
            assert part == pytest.approx(np.clip((verdict.distance - 0.06) / 0.06, 0, 1), abs=1e-3)
            slow, still = slow + bool(0 < part[0] < 1), still + (part[0] == 0)
            observation, verdict = task.step(agent.policy(observation, task.program))
        assert verdict.satisfied
    assert slow and still


def test_a_hand_without_a_gripper_is_not_slowed() -> None:
    task = ReachTask(preset_named("push"), design_named("push-3D"), seed=1)
    agent = load_agent("shipped:push")
    actor = Actor.of(agent.snapshot)
    observation, verdict = task.reset(0, "reach-eval")
    while not verdict.satisfied:
        assert not verdict.truncated
        observation, verdict = task.step(agent.policy(observation, task.program))
    full = actor.infer(observation, task.program)
    np.testing.assert_array_equal(actor.act(observation, task.program), full)


def test_a_stage_that_the_goal_lacks_is_rejected(task: ReachTask, agent: Agent) -> None:
    observation, verdict = task.reset(0, "chain-2")
    with rejected("observation.stage", "expected less than 2, as THEN"):
        agent.observe(Step(observation, replace(verdict, stage=2)), task.goal)
    assert not agent.waiting


def test_an_agent_that_learns_refuses_goals_over_time_and_sends_nothing_of_them() -> None:
    arm = Arm(following())
    arm.reset(0)
    arm.run(3)
    goal = parse_goal("ALL(NEAR(HAND, RED), NEAR(HAND, NOT(RED)))", WORDS)
    with rejected("program.over_time"):
        arm.agent.check_program(goal)
    observation, verdict = arm.task.set_program(goal)
    assert arm.agent.observe(Step(observation, verdict), goal) is None
    assert arm.agent.prepare() is None
    with rejected("program.over_time"):
        arm.agent.act()
    assert arm.sent == [] and arm.agent.interrupted == 1


def test_weights_that_did_not_learn_to_avoid_refuse_it(agent: Agent) -> None:
    goal = parse_goal("THEN(NEAR(HAND, RED), AVOID(RED, NEAR(HAND, BLUE)))", DESIGN.vocabulary)
    agent.observe(Step(ReachTask(FAST, DESIGN, seed=1).reset(0)[0]), stages(goal)[0])
    with rejected("program.avoids"):
        agent.check_program(goal)


def test_a_goal_is_watched_until_it_is_violated_and_longer_for_more_programs() -> None:
    text = "THEN(NEAR(HAND, RED), AVOID(CUBE, LEFT_OF(HAND, BLUE)))"
    assert window_s(text) == 2 * window_s("NEAR(HAND, RED)")
    watch = ExecutionWatch("mine")
    step = judged(1, False, 10**8, program_id="mine")
    assert step.verdict is not None and watch.observe(step) is None
    after = replace(step, verdict=replace(step.verdict, stage=1, violated=True))
    result = watch.observe(after)
    assert result is not None and (result.satisfied, result.ended) == (False, "violated")
    assert result.text(text) == (
        "not satisfied: an object to be avoided was near, after 0.0 s, in stage 2 of 2, "
        "at 0.50 of the limits"
    )
