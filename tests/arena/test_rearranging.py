"""Moving, adding and removing blocks during an episode."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.appearance import look_of
from pa_ros.arena.designs import Kind
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.rearranging import LARGEST_M_S, LARGEST_RAD_S, bodies, rearrange
from pa_ros.core.experience import Body
from pa_ros.language import parse

FLAT = np.array([0.0, 0.0, 0.0, 1.0])
FAR = np.array([-0.4, -0.4, 0.0])


def begun(steps: int = 5) -> ReachTask:
    task = ReachTask(preset_named("fast"), design_named("3-D"), 2)
    task.reset(0)
    for _ in range(steps):
        task.step(np.full(len(task.config.joint_speed_limits), 0.3))
    return task


def kinds_of(task: ReachTask) -> list[Kind]:
    return [block.kind for block in task.episode.blocks]


def hold(task: ReachTask, steps: int = 1):
    for _ in range(steps):
        seen = task.step(np.zeros(len(task.config.joint_speed_limits)))
    return seen


def test_rearranging_to_the_same_places_changes_nothing():
    task, other = begun(), begun()
    rearrange(task, kinds_of(task), bodies(task)[1:], range(4))
    for _ in range(20):
        ours, theirs = hold(task)[0], hold(other)[0]
        assert np.allclose(ours.objects, theirs.objects, atol=1e-4)
        assert np.allclose(ours.joint_position, theirs.joint_position, atol=1e-4)
    assert ours.stamp_ns == theirs.stamp_ns and ours.step == theirs.step == 25


def test_a_block_rests_at_its_new_place_and_the_arm_continues():
    task = begun()
    before = task.simulation.joint_position
    moved = bodies(task)[1:]
    moved[1] = Body.at_rest(FAR, FLAT)  # inside the table, so it is raised onto it
    rearrange(task, kinds_of(task), moved, [1])
    assert np.array_equal(task.simulation.joint_position, before)
    hold(task, 10)
    place = task.simulation.positions[2]
    assert place[:2] == pytest.approx(FAR[:2], abs=1e-3)
    assert place[2] == pytest.approx(look_of(kinds_of(task)[1]).rest_height, abs=1e-3)


@pytest.mark.parametrize("index", [0, 1, 3])
def test_poses_and_velocities_are_reported_as_given(index: int):
    task = begun()
    spun = bodies(task)[1:]
    turned = np.array([np.sin(0.4), 0.0, 0.0, np.cos(0.4)])  # not about the vertical
    given = Body(FAR + [0, 0, 0.4], turned, np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]))
    spun[index] = given
    rearrange(task, kinds_of(task), spun, [index])
    reported = bodies(task)[index + 1]
    for name in ("position", "quaternion", "linear", "angular"):
        assert getattr(reported, name) == pytest.approx(getattr(given, name), abs=1e-6), name


@pytest.mark.parametrize("yaw", [-2.5, -0.4, 0.9, 3.0])
def test_a_tilted_block_keeps_the_yaw_of_its_x_axis(yaw: float):
    task = begun(0)
    tilted, placed = Rotation.from_euler("ZYX", [yaw, -0.6, 0.3]), bodies(task)[1:]
    placed[0] = Body.at_rest(FAR + [0, 0, 0.3], tilted.as_quat())
    rearrange(task, kinds_of(task), placed)
    assert task.episode.blocks[0].yaw == pytest.approx(yaw)


def test_the_program_stays_while_its_target_is_removed_and_added_again():
    task = begun()
    kinds, placed = kinds_of(task), bodies(task)[1:]
    target = kinds[0]
    text = f"NEAR(HAND, AND({', '.join(sorted(target.words))}))"
    task.set_program(parse(text, task.design.vocabulary), "mine")
    rearrange(task, kinds[1:], placed[1:])
    observation, verdict = hold(task)
    assert len(observation.objects) == 4 and observation.program_id == "mine"
    assert verdict.distance == float("inf") and not verdict.satisfied
    hand = bodies(task)[0].position
    beside = Body.at_rest(np.array([hand[0], hand[1], 0.0]), FLAT)
    rearrange(task, [*kinds_of(task), target], [*bodies(task)[1:], beside], [3])
    observation, verdict = hold(task)
    assert len(observation.objects) == 5 and np.isfinite(verdict.distance)
    assert observation.program_id == "mine"


@pytest.mark.parametrize("part", ["linear", "angular"])
def test_speeds_are_limited_to_those_that_the_physics_stands(part: str):
    task, most = begun(), {"linear": LARGEST_M_S, "angular": LARGEST_RAD_S}[part]
    thrown = Body.at_rest(FAR + [0, 0, 0.4], FLAT)
    for speed in (-most, 1.01 * most, 1e300):
        placed = bodies(task)[1:]
        placed[1] = replace(thrown, **{part: np.array([0.0, 0.0, speed])})
        if speed > most:
            with pytest.raises(ArenaError, match="twist: expected at most 10 m/s and 100 rad/s"):
                rearrange(task, kinds_of(task), placed, [1])
        else:
            rearrange(task, kinds_of(task), placed, [1])
            hold(task, 20)
    assert np.isfinite(hold(task)[0].objects).all()


@pytest.mark.parametrize(
    ("position", "quaternion", "says"),
    [
        (np.array([0.0, 2.0, 0.0]), FLAT, "within 0.8 m"),
        (np.array([0.0, np.nan, 0.0]), FLAT, "finite"),
        (np.full(3, 1e300), FLAT, "within 0.8 m"),
        (FAR, np.full(4, 1e300), "unit quaternion"),
        (FAR, np.zeros(4), "unit quaternion"),
        (None, FLAT, "to every other block"),
    ],
)
def test_impossible_poses_are_rejected_and_nothing_changes(position, quaternion, says):
    task = begun()
    placed = bodies(task)[1:]
    where = placed[1].position if position is None else position
    wrong = [Body.at_rest(where, quaternion), *placed[1:]]
    before = task.simulation.positions
    with pytest.raises(ArenaError, match=says):
        rearrange(task, kinds_of(task), wrong, [0])
    assert np.array_equal(task.simulation.positions, before)
    with pytest.raises(ArenaError, match="at least one"):
        rearrange(task, [], [])
