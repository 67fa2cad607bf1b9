"""A learner and an agent learn on an arm of robot_node: it asks for its blocks, is never reset, and
says what it did in place of what was asked; a person may take it over."""

from itertools import pairwise

import numpy as np
import pytest
from control_msgs.msg import JointJog
from geometry_msgs.msg import TwistStamped

from agent_node.node import AgentNode
from helpers.graph import (
    ACTIVATE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    SMALL_LEARNER,
    User,
    graph,
)
from helpers.robots import SIMULATED, learning_robot, pressed
from helpers.waiting import DEADLINE_S, wait_for
from learner_node.node import LearnerNode
from pa_ros.core.experience import PERSON
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.learning import decode_trajectory
from sim_node.robot.node import RobotNode

pytestmark = pytest.mark.graph
FEATURES = topics.OBJECT_FEATURES.name


@pytest.fixture(scope="module")
def lesson(module_domain, tmp_path_factory):
    file = learning_robot(tmp_path_factory.mktemp("robot"), dry_run=False)
    robot = {"robot_node__robot": file, "robot_node__autostart": True}
    agent = {"agent_node__learning": True, "agent_node__weights": "topic"}
    nodes = SIMULATED.ArmDriver, RobotNode, AgentNode, LearnerNode
    with graph(*nodes, **robot, **agent, **SMALL_LEARNER) as probe:
        assert probe.until(lambda: "scatter the blocks" in probe.message("robot_node"))
        assert not probe.nodes[0].arm.velocity.any()
        assert not probe.heard[FEATURES], "nothing is asked of an agent before"
        assert probe.until(lambda: bool(probe.nodes[1].arm.measured))
        assert pressed(probe, topics.RESUME).success
        yield probe


def test_it_learns_from_what_the_arm_did(lesson):
    assert lesson.learns(20)
    world = lesson.nodes[1].arm.about.world
    sent = [decode_trajectory(one, world) for one in lesson.heard[topics.TRAJECTORIES.name]]
    steps = {(one.episode, one.step): one for one in lesson.heard[FEATURES]}
    assert sent and all(1 <= len(one) <= 10 for one in sent)
    for one in sent:
        for t, action in enumerate(one.actions):
            after = steps[one.episode, one.first_step + t + 1]
            assert action.tolist() == list(after.applied) and np.abs(action).max() <= 1.0
            assert after.commanded_by == lesson.nodes[2].agent_id
    episodes = [one.episode for one in lesson.heard[FEATURES]]
    assert len({*episodes}) > 1 and episodes == sorted(episodes)
    stamps = [(o.header.stamp.sec, o.header.stamp.nanosec) for o in lesson.heard[FEATURES]]
    assert stamps == sorted({*stamps})
    ends = [(a, b) for a, b in pairwise(lesson.heard[FEATURES]) if a.truncated]
    assert ends and all(b.step == 0 and b.joint_position == a.joint_position for a, b in ends)


def test_a_person_takes_over_within_the_speed_scale_and_the_bag_shows_it(lesson):
    takeover, driver = lesson.speaker(topics.TAKEOVER), lesson.nodes[0]
    twist = TwistStamped()
    twist.header.frame_id, twist.twist.linear.z = "world", 5.0
    before = lesson.count(topics.OBJECT_FEATURES)

    def moved() -> bool:
        takeover.publish(twist)
        heard = lesson.heard[FEATURES][before:]
        told = lesson.value("robot_node", "moved_by") == PERSON
        return told and sum(one.commanded_by == PERSON for one in heard) > 5

    assert lesson.until(moved)
    limit = 0.5 * max(SIMULATED.CONFIG.joint_speed_limits)
    assert 0.2 < np.abs(driver.arm.velocity).max() <= limit + 1e-9
    taken = lesson.count(topics.TRAJECTORIES)
    assert lesson.until(lambda: lesson.count(topics.TRAJECTORIES) > taken)
    ours = lambda: lesson.last(topics.OBJECT_FEATURES).commanded_by  # noqa: E731
    assert lesson.until(lambda: ours() == lesson.nodes[2].agent_id), "the agent acts again"
    twist.header.frame_id = "elbow"
    takeover.publish(twist)
    assert lesson.until(lambda: lesson.value("robot_node", "refused.wire.frame") != "")


def test_a_person_takes_over_by_the_joints_too(lesson):
    takeover, jog = lesson.speaker(topics.TAKEOVER_JOINTS), JointJog()
    jog.joint_names, jog.velocities = ["joint_6"], [-0.3]

    def taken() -> bool:
        takeover.publish(jog)
        *others, last = lesson.nodes[0].arm.velocity
        marked = lesson.last(topics.OBJECT_FEATURES).commanded_by == PERSON
        return marked and last < 0.0 and not any(others)

    assert lesson.until(taken)
    for jog.joint_names in (["elbow"], ["joint_6", "joint_6"]):
        takeover.publish(jog)
        assert lesson.until(lambda: lesson.value("robot_node", "refused.wire.joint_names") != "")
    ours = lambda: lesson.last(topics.OBJECT_FEATURES).commanded_by  # noqa: E731
    assert lesson.until(lambda: ours() == lesson.nodes[2].agent_id)


def test_it_holds_until_the_blocks_are_scattered_and_goes_on_without_a_jump(lesson):
    assert pressed(lesson, topics.SCATTER).success
    driver = lesson.nodes[0]
    assert lesson.until(lambda: not driver.arm.velocity.any())
    before = driver.arm.data.qpos[:6].copy()
    driver.scatter(7)
    assert driver.arm.data.qpos[:6] == pytest.approx(before, abs=1e-6)
    # As a person does: again, if the blocks are not all measured yet.
    wait_for(lambda: "continues with" in pressed(lesson, topics.RESUME).message)
    assert lesson.learns(20)
    assert lesson.value("robot_node", "scatters") == "1"


def test_what_stops_the_arm_interrupts_a_lesson_and_joins_no_steps(lesson, monkeypatch):
    driver, before = lesson.nodes[0], lesson.count(topics.OBJECT_FEATURES)
    with monkeypatch.context() as lost:
        lost.setattr(driver.joints, "publish", lambda _: None)
        assert lesson.until(lambda: "holds: joint_states" in lesson.message("robot_node"))
        assert not driver.arm.velocity.any()
    assert lesson.learns(20)
    after = [one for one in lesson.heard[FEATURES][before:] if not one.commanded_by and one.step]
    assert after, "nobody commanded what the arm did while it held"


@pytest.mark.parametrize("hidden", [1, 4])  # by a person in between; the tracker is lost
def test_objects_that_are_lost_interrupt_a_lesson_and_nothing_is_learned_meanwhile(lesson, hidden):
    driver = lesson.nodes[0]
    seen = driver.see
    with pytest.MonkeyPatch.context() as lost:
        lost.setattr(driver, "see", lambda found, at: seen(dict([*found.items()][hidden:]), at))
        assert lesson.until(lambda: "holds: " in lesson.message("robot_node"))
        assert lesson.until(lambda: not driver.arm.velocity.any())
        before = driver.arm.data.qpos[:6].copy()
        learned = lesson.count(topics.OBJECT_FEATURES)
        lesson.until(lambda: False, 0.5)
        assert lesson.count(topics.OBJECT_FEATURES) == learned
        assert driver.arm.data.qpos[:6] == pytest.approx(before, abs=0.02)
    assert lesson.learns(5)


def test_nothing_is_learned_from_an_arm_that_was_stopped_and_does_not_follow(lesson):
    driver, own = lesson.nodes[0], lesson.heard[FEATURES]
    with pytest.MonkeyPatch.context() as stopped:
        driver.arm.data.qvel[:6] = 0.0
        stopped.setattr(driver.arm, "advance", lambda _: None)
        assert lesson.until(lambda: "does not follow" in lesson.message("robot_node"))
        before = len(own)
        assert lesson.until(lambda: len(own) > before + 10)
        assert not any(one.commanded_by for one in own[before + 1 :])
    assert lesson.learns(5) and lesson.until(lambda: lesson.message("robot_node") == "running")


@pytest.mark.parametrize("hours", [-1, 1])
def test_a_drivers_wall_clock_that_is_set_costs_no_lesson(lesson, monkeypatch, hours):
    set_by, stamps = hours * 3600 * 10**9, lesson.heard[FEATURES]
    before, now_ns = len(stamps), SIMULATED.now_ns
    monkeypatch.setitem(vars(SIMULATED), "now_ns", lambda: now_ns() + set_by)
    assert lesson.learns(5)
    told = [header_stamp(one) for one in stamps[before:]]
    assert told == sorted(told) and told[-1] - told[0] < 1e9 * DEADLINE_S


def test_it_continues_after_it_was_inactive_and_refuses_to_resume_with_too_few_blocks(lesson):
    user = User(lesson, lesson.nodes[1])
    assert user.ask(DEACTIVATE) == (True, "inactive")
    assert lesson.until(lambda: not lesson.nodes[0].arm.velocity.any())
    assert user.ask(ACTIVATE) == (True, "active")
    assert lesson.learns(20)
    lesson.nodes[1].arm.lessons.blocks = 3
    answer = pressed(lesson, topics.RESUME)
    assert not answer.success and "expected 3 objects on the table" in answer.message


def test_it_learns_again_after_a_restart_and_nothing_in_a_dry_run(lesson, tmp_path):
    user, heard = User(lesson, lesson.nodes[1]), lesson.heard[topics.TRAJECTORIES.name]
    for dry_run in (False, True):
        for number in (DEACTIVATE, CLEANUP):
            assert user.ask(number)[0]
        assert user.set("robot", learning_robot(tmp_path, dry_run)) == ""
        for number in (CONFIGURE, ACTIVATE):
            assert user.ask(number)[0]
        assert lesson.until(lambda: bool(lesson.nodes[1].arm.measured))
        assert pressed(lesson, topics.RESUME).success
        if not dry_run:
            assert lesson.learns(20)  # the learner and its weights are the same
    sent, commands = len(heard), lesson.count(topics.JOINT_COMMANDS)
    assert lesson.until(lambda: lesson.count(topics.JOINT_COMMANDS) > commands + 10)
    assert len(heard) <= sent + 1, "what was collected before"
    assert not lesson.last(topics.OBJECT_FEATURES).commanded_by
    assert not lesson.nodes[0].arm.velocity.any()
