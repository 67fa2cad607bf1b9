"""An arm on its own table is an arena that can be learned from, without resets."""

import numpy as np
import pytest

from helpers.robots import DESIGN, NAMES, Rehearsal, robot_values
from pa_ros.arena import ArenaError, training_programs
from pa_ros.core.errors import ConfigError
from pa_ros.language.errors import ProgramError
from pa_ros.wire.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.program import ProgramRequest
from sim_node.robot.arm import RealArm
from sim_node.robot.frames import Placed
from sim_node.robot.settings import read_robot

LEARNING = {"episode_s": 0.5, "scatter_every_min": 1.0}


def learning(index: int = 0, **changes) -> Rehearsal:
    rehearsal = Rehearsal(index, **{"learning": LEARNING, **changes})
    rehearsal.observe()
    rehearsal.arm.take_blocks(rehearsal.now_s)
    rehearsal.observe()
    return rehearsal


def test_the_description_says_what_is_trained_and_what_is_held_out():
    arm = RealArm(read_robot(robot_values(learning=LEARNING)))
    about = decode_arena_info(encode_arena_info(arm.about))
    present = {"NEAR(HAND, AND(RED, SPHERE))", "NEAR(HAND, AND(GREEN, CUBE))"}
    assert set(map(str, about.training_programs)) == present  # of the design, with these blocks
    assert set(about.training_programs) < set(training_programs(DESIGN))
    assert (about.episode_steps, about.block_count) == (5, 4)
    assert arm.lessons.held_out == ("CUBE RED", "CYLINDER BLUE")
    given = {**LEARNING, "programs": ["NEAR(HAND, RED)"]}
    arm = RealArm(read_robot(robot_values(learning=given)))
    assert list(map(str, arm.about.training_programs)) == ["NEAR(HAND, RED)"]


@pytest.mark.parametrize(
    ("programs", "error", "told"),
    [
        (["NEAR(HAND, AND(GREEN, SPHERE))"], ConfigError, "expected one that names an object"),
        (["NEAR(HAND, PURPLE)"], ProgramError, "unknown word"),
    ],
)
def test_programs_that_cannot_be_trained_are_refused_at_the_start(programs, error, told):
    with pytest.raises(error, match=told):
        RealArm(read_robot(robot_values(learning={**LEARNING, "programs": programs})))


def test_an_episode_begins_where_the_last_one_ended_with_what_does_not_hold_yet():
    rehearsal, begun = learning(), []
    for _ in range(6):
        before = rehearsal.arm.seen
        first = rehearsal.arm.begin_episode(before.stamp_ns + 1)
        assert first.observation.joint_position.tolist() == before.joint_position.tolist()
        assert not first.verdict.satisfied and first.observation.step == 0
        begun.append((first.observation.episode, first.program))
        for step in range(1, 6):
            rehearsal.advance(np.full(6, 0.3))
            seen = rehearsal.observe()
            assert (seen.observation.episode, seen.observation.step) == (begun[-1][0], step)
            assert seen.verdict.truncated == (step == 5)
    assert [number for number, _ in begun] == [1, 2, 3, 4, 5, 6]
    assert len({program for _, program in begun}) == 2


def test_a_program_that_holds_already_is_not_begun():
    rehearsal = learning()
    arm, hand = rehearsal.arm, rehearsal.arm.measured["hand"]
    for name in NAMES:  # a person brings them all
        arm.frames.add("world", name, Placed(hand, rehearsal.stamp_ns + 1, rehearsal.now_s))
    seen = rehearsal.observe().observation
    with pytest.raises(ArenaError, match="scatter the blocks") as error:
        arm.begin_episode(seen.stamp_ns + 1)
    assert error.value.code == "robot.programs" and arm.seen is seen


def test_a_program_that_would_need_the_hand_outside_its_box_is_refused():
    box = {"lower": [-0.8, -0.8, 0.5], "upper": [0.8, 0.8, 0.8]}  # far above the blocks
    rehearsal = learning(workspace=box)
    with pytest.raises(ArenaError, match="would have to leave its box") as error:
        rehearsal.arm.submit(ProgramRequest("p", "NEAR(HAND, BLUE)"))
    assert error.value.code == "robot.box" and not rehearsal.arm.program
    with pytest.raises(ArenaError, match="can be reached within the box"):
        rehearsal.arm.begin_episode(rehearsal.stamp_ns + 1)


def test_blocks_that_were_taken_away_do_not_count_and_their_number_must_be_right():
    rehearsal = Rehearsal(learning={**LEARNING, "blocks": 3}, objects_timeout_s=1.0)
    rehearsal.observe()
    with pytest.raises(ArenaError, match="expected 3 objects on the table.*got 4") as error:
        rehearsal.arm.take_blocks(rehearsal.now_s)
    assert error.value.code == "robot.blocks"
    rehearsal.lost = {NAMES[1]}
    for _ in range(20):
        rehearsal.advance(np.zeros(6))
    assert rehearsal.arm.take_blocks(rehearsal.now_s) == (NAMES[0], *NAMES[2:])
    assert len(rehearsal.observe().observation.objects) == 4
    first = rehearsal.arm.begin_episode(rehearsal.stamp_ns + 1)
    assert first.program == "NEAR(HAND, AND(RED, SPHERE))"


def test_a_person_is_asked_to_scatter_after_the_time_that_the_file_says():
    rehearsal = learning()
    lessons, verdict = rehearsal.arm.lessons, rehearsal.arm.begin_episode(1).verdict
    for step in range(600):  # a minute
        assert not lessons.scatter_is_due, step
        lessons.count(verdict, held=step % 4 == 0)
    assert lessons.scatter_is_due
    told = {"reward_per_step": "-1.000", "held_share": "0.250", "scatters": "0"}
    assert lessons.report() == {**told, "steps_to_scatter": "0"}
    rehearsal.arm.leave_blocks()
    rehearsal.lost = {*NAMES}  # they are in a person's hands
    rehearsal.advance(np.zeros(6))
    assert len(rehearsal.observe().observation.objects) == 1
    rehearsal.arm.take_blocks(rehearsal.now_s)
    assert not lessons.scatter_is_due and lessons.report()["scatters"] == "1"


def test_agents_see_a_slow_arm_where_it_will_be_when_it_has_done_what_was_sent():
    late, velocity = Rehearsal(arm_delay_s=0.1), np.array([0.4, 0.2, -0.3, 0.1, 0.2, 0.5])
    prompt = Rehearsal()
    for rehearsal in (late, prompt):
        rehearsal.observe()
    late.arm.believed.sent(velocity, late.now_s)  # the arm has not begun to move
    late.now_s += 0.1
    late.measure()
    prompt.advance(velocity)
    ahead, there = late.observe().observation, prompt.observe().observation
    assert ahead.joint_position == pytest.approx(there.joint_position, abs=0.02)
    assert ahead.hand_pose == pytest.approx(there.hand_pose, abs=0.02)
    assert ahead.objects[:, :3] == pytest.approx(there.objects[:, :3], abs=0.02)
    assert ahead.joint_velocity.tolist() == velocity.tolist()


def test_an_arm_that_was_stopped_does_not_follow_until_it_moves_again():
    rehearsal, velocity = learning(), np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    told = []
    for step in range(60):
        stopped = 20 <= step < 40
        rehearsal.arm.believed.sent(velocity, rehearsal.now_s)
        rehearsal.advance(np.zeros(6) if stopped else velocity)
        rehearsal.observe()
        told.append(rehearsal.arm.follows)
    assert all(told[:20]) and not any(told[31:40]) and all(told[45:])
    rehearsal.arm.believed.sent(np.zeros(6), rehearsal.now_s)
    for _ in range(20):  # at rest, as it should be
        rehearsal.advance(np.zeros(6))
        rehearsal.observe()
        assert rehearsal.arm.follows


def test_a_person_moves_the_hand_in_the_bases_frame_or_its_own():
    rehearsal = learning()
    arm, wanted = rehearsal.arm, np.array([0.05, -0.03, 0.02])
    before = arm.seen.hand_pose[:3]
    rehearsal.advance(arm.twist(wanted, np.zeros(3), in_hand=False))
    moved = rehearsal.observe().observation.hand_pose[:3] - before
    assert moved == pytest.approx(0.1 * wanted, abs=1e-3)
    own = arm.model.hand(arm.seen.joint_position).turn.T @ wanted
    again = arm.twist(own, np.zeros(3), in_hand=True)
    assert again == pytest.approx(arm.twist(wanted, np.zeros(3), in_hand=False))
    joints = np.array([0.1, 0.2, 0.0, 0.0, 0.0, 0.0])
    assert arm.jog(joints).tolist() == joints.tolist()
    assert np.abs(arm.jog(100 * joints)).max() == pytest.approx(max(arm.about.speed_limits[:2]))
    fast = arm.twist(10 * wanted, np.zeros(3), in_hand=False)
    assert np.abs(fast / arm.about.speed_limits).max() == pytest.approx(1.0)
