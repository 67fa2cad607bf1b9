"""A real arm without ROS: frames, joints and the box; it moves only while all is measured."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.robots import CONFIG, DESIGN, NAMES, PERIOD_S, Rehearsal
from pa_ros.acting.executing import Actor
from pa_ros.arena import ArenaError
from pa_ros.arena.camera import Camera, intrinsics, optical_pose
from pa_ros.core.extensions import load
from pa_ros.language import parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.tools.scenes import Scene
from pa_ros.wire.program import ProgramRequest
from pa_ros.world.poses import in_base, in_hand
from sim_node.robot.arm import RealArm
from sim_node.robot.frames import FrameTree, Placed
from sim_node.robot.guard import SLOW_S, Guard
from sim_node.robot.joints import JointHistory
from sim_node.robot.settings import DriverJoint, Workspace, load_robot

AGENT, EXAMPLES = Path("shipped:3-D"), Path(__file__).parents[2] / "docs/examples"
POSES = st.integers(0, 2**32).map(lambda seed: _random_pose(np.random.default_rng(seed)))
JOINTS = (DriverJoint(name="a"), DriverJoint(name="b", sign=-1, offset=0.5))


def _random_pose(rng):
    turn = rng.normal(size=4)
    return np.array([*rng.normal(size=3), *turn / np.linalg.norm(turn)])


def refused(call, *given):
    with pytest.raises(ArenaError) as error:
        call(*given)
    return error.value.code, str(error.value)


# Frames


@given(POSES, POSES, POSES)
def test_a_pose_is_found_along_both_branches_of_the_tree(camera, hand, tag):
    tree = FrameTree()
    tree.add("world", "camera", Placed(camera))
    tree.add("world", "hand", Placed(hand, 5, 1.0))
    tree.add("camera", "tag", Placed(tag, 7, 2.0))
    found = tree.pose("hand", "tag")
    assert found.pose == pytest.approx(in_hand(hand, in_base(camera, tag)), abs=1e-9)
    assert (found.stamp_ns, found.arrived_s) == (5, 1.0)  # of the older of the two
    sign = np.array([1.0] * 3 + [np.sign(tag[6])] * 4)  # of its quaternion
    assert tree.pose("camera", "tag").pose == pytest.approx(tag * sign, abs=1e-9)


def test_frames_that_nothing_joins_are_named():
    tree = FrameTree()
    tree.add("world", "hand", Placed(np.eye(7)[6]))
    tree.add("map", "tag", Placed(np.eye(7)[6]))
    assert "does not join 'tag' and 'world'" in refused(tree.pose, "world", "tag")[1]
    assert "did you mean 'hand'" in refused(tree.pose, "world", "hend")[1]
    tree.hear({"gripper"})
    assert "did you mean 'gripper'" in refused(tree.pose, "world", "griper")[1]


def test_frames_above_a_wanted_one_become_wanted_in_any_order():
    tree, pose = FrameTree(), Placed(np.eye(7)[6])
    tree.want(["hand", "world"])
    tree.add("world", "base", pose)  # static ones are sent once, and early
    tree.add("base", "wrist", pose)
    assert tree.wanted == ("hand", "world")
    tree.add("wrist", "hand", pose)
    assert tree.wanted == ("hand", "wrist", "base", "world")


def test_a_transform_that_closes_a_circle_or_makes_the_tree_too_deep_is_forgotten():
    tree, pose = FrameTree(), Placed(np.eye(7)[6])
    tree.want(["hand"])
    tree.add("world", "hand", pose)
    assert refused(tree.add, "hand", "world", pose)[0] == "robot.frames"
    assert refused(tree.add, "hand", "hand", Placed(np.eye(7)[6], 9))[0] == "robot.frames"
    for parent, child in (("a", "b"), ("b", "a")):  # of nobody's interest, until now
        tree.add(parent, child, pose)
    assert refused(tree.add, "a", "world", pose)[0] == "robot.frames"
    assert tree.wanted == ("hand", "world") and tree.pose("world", "hand").stamp_ns == 0
    tree.add("0", "world", pose)
    with pytest.raises(ArenaError, match="at most 100 frames"):
        for i in range(200):
            tree.add(str(i + 1), str(i), pose)
    assert tree.pose("world", "hand").pose.tolist() == pose.pose.tolist()


def test_the_same_measurement_sent_again_is_not_newer():
    tree = FrameTree()
    for arrived_s in (1.0, 2.0):
        tree.add("world", "tag", Placed(np.eye(7)[6], 5, arrived_s))
    assert tree.pose("world", "tag").arrived_s == 1.0


def test_a_pose_without_a_stamp_grows_old() -> None:
    tree = FrameTree()
    tree.add("world", "hand", Placed(np.eye(7)[6]))
    tree.add("world", "cup", Placed(np.eye(7)[6], 0, 1.0))
    found = tree.pose("hand", "cup")
    assert (found.stamp_ns, found.arrived_s) == (0, 1.0)


# Joints


def test_joints_are_resampled_in_the_agents_signs():
    history = JointHistory(JOINTS)
    history.add(np.array([0.0, 0.0]), np.array([1.0, 1.0]), 10, 1.0)
    history.add(np.array([1.0, 1.0]), np.array([3.0, 3.0]), 20, 2.0)
    between = history.at(15)
    assert between.position.tolist() == [0.5, 0.0] and between.velocity.tolist() == [2.0, -2.0]
    for stamp in (20, 99, 5):
        assert history.at(stamp).position.tolist() == [1.0, -0.5], "the newest"
    position, velocity = history.to_driver(np.array([1.0, -0.5]), np.array([1.0, 1.0]))
    assert position.tolist() == [1.0, 1.0] and velocity.tolist() == [1.0, -1.0]
    history.add(np.array([2.0, 2.0]), np.zeros(2), 3, 3.0)  # the driver was restarted
    assert history.at(15).position.tolist() == [2.0, -1.5]
    assert refused(JointHistory(JOINTS).at, 0)[0] == "robot.joints"
    unstamped = refused(history.add, np.zeros(2), np.zeros(2), 0, 3.0)
    assert unstamped[0] == "robot.joints" and "header.stamp" in unstamped[1]


# The box


@given(st.integers(0, 2**32))
def test_the_hand_approaches_a_face_no_faster_than_the_distance_allows(seed):
    rng = np.random.default_rng(seed)
    box = Workspace(lower=(0, 0, 0), upper=(1, 1, 1))
    acceleration = rng.choice([0.0, 2.0])
    guard = Guard(box, -np.ones(6), np.ones(6), 2 * np.ones(6), acceleration)
    slow_s = SLOW_S + (0.5 if acceleration else 0.0)  # half of the ramp from 2 rad/s
    velocity, position = rng.normal(size=6), rng.uniform(-1, 1, 6)
    jacobian = rng.normal(size=(3, 6))
    hand = rng.uniform(-0.2, 1.2, 3)
    allowed = guard.allowed(velocity, position, hand, jacobian)
    assert np.all(jacobian @ allowed <= np.maximum(1 - hand, 0) / slow_s + 1e-6)
    assert np.all(-jacobian @ allowed <= np.maximum(hand, 0) / slow_s + 1e-6)
    assert np.all(np.abs(allowed) <= np.minimum((1 + np.abs(position)) / slow_s, 2) + 1e-6)


def test_far_from_the_box_a_command_is_not_changed_and_along_a_face_the_hand_slides():
    box = Workspace(lower=(-9, -9, 0), upper=(9, 9, 9))
    guard = Guard(box, -np.ones(3), np.ones(3), np.ones(3))
    wanted, still = np.array([0.1, 0.0, -0.2]), np.zeros(3)
    assert guard.allowed(wanted, still, np.ones(3), np.eye(3)) == pytest.approx(wanted)
    slid = guard.allowed(wanted, still, np.array([1.0, 1.0, 0.0]), np.eye(3))
    assert slid == pytest.approx([0.1, 0.0, 0.0], abs=1e-6)


# The arm


def test_the_hand_comes_to_rest_in_the_box_wherever_the_arm_falls_silent():
    box = {"lower": [-0.6, -0.6, 0.05], "upper": [0.6, 0.6, 0.6]}
    arm = Rehearsal(max_acceleration=2.0, workspace=box).arm
    limits = np.clip([arm.about.joint_lower, arm.about.joint_upper], -np.pi, 2 * np.pi)
    rng, near = np.random.default_rng(0), 0

    def outside(position):
        hand = arm.model.hand(position).place
        return max(*(hand - box["upper"]), *(box["lower"] - hand))

    while near < 40:
        arm.believed.position = position = rng.uniform(*limits)
        if outside(position) > 0:
            continue
        velocity = arm.allowed(rng.choice([-1.5, 1.5], 6))
        to_rest_s = 0.4 + np.abs(velocity).max() / 2.0 / 2
        ways = [outside(position + velocity * s) for s in np.linspace(0, to_rest_s, 30)]
        assert max(ways) < 0.02
        near += max(ways) > -0.01 and np.abs(velocity).max() > 0.1


def test_the_hand_stays_in_the_box_whatever_is_commanded():
    low, high = np.array([-0.45, -0.45, 0.2]), np.array([0.45, 0.45, 0.45])
    box = {"lower": low.tolist(), "upper": high.tolist()}
    table = Rehearsal(speed_scale=0.3, workspace=box)
    rng, speeds = np.random.default_rng(0), []
    for push in rng.choice([-1.0, 1.0], (30, 6)).repeat(10, axis=0):
        table.observe()
        allowed = table.arm.allowed(push * table.arm.about.speed_limits)
        speeds.append(np.linalg.norm(table.arm.hand_velocity(allowed)))
        table.advance(allowed)
        hand = table.plant.hand_pose[:3]
        assert np.all(hand > low - 0.01) and np.all(hand < high + 0.01)
    assert max(speeds) > 0.1, "it did move"


def test_tools_draw_a_real_arms_table():
    table = Rehearsal()
    assert Scene(table.arm.about, table.observe()).picture(64).shape == (64, 64, 3)


def test_the_speed_scale_slows_the_arm():
    table = Rehearsal(speed_scale=0.25)
    table.arm.submit(ProgramRequest("p", "NEAR(HAND, RED)"))
    table.observe()
    velocity = table.arm.velocity(table.command(np.full(6, 7.0)))
    assert velocity == pytest.approx(0.25 * np.array(CONFIG.joint_speed_limits))


@pytest.mark.parametrize(
    ("lost", "after_s", "code", "named"),
    [
        ("joints", 0.3, "robot.joints", "joint_states"),
        ("hand", 0.3, "robot.poses", "hand"),
        (NAMES[2], 0.6, "robot.poses", NAMES[2]),
    ],
)
def test_what_is_lost_stops_the_observations_and_is_named(lost, after_s, code, named):
    table = Rehearsal()
    table.observe()
    table.lost.add(lost)
    for _ in range(round(after_s / PERIOD_S)):
        table.advance(np.zeros(6))
    found, text = refused(table.observe)
    assert found == code and named in text
    table.lost.clear()
    table.advance(np.zeros(6))
    table.observe()


def test_a_wrong_joint_map_is_found_before_the_arm_moves():
    joints = [{"name": f"joint_{i}", "sign": -1 if i == 2 else 1} for i in range(1, 7)]
    assert refused(Rehearsal(joints=joints).observe)[0] == "robot.model"


def test_whole_turns_between_driver_and_model_do_not_matter():
    joints = [{"name": f"joint_{i}", "offset": 0.0 if i == 1 else 2 * np.pi} for i in range(1, 7)]
    one, other = Rehearsal().observe(), Rehearsal(joints=joints).observe()
    turned = one.observation.joint_position, other.observation.joint_position
    assert turned[0] == pytest.approx(turned[1])


def test_a_command_that_answers_no_recent_observation_moves_nothing():
    table = Rehearsal()
    table.observe()
    command = table.command(np.ones(6))
    assert refused(table.arm.velocity, command)[0] == "command.stale"  # no program
    table.arm.submit(ProgramRequest("p", "NEAR(HAND, RED)"))
    table.arm.velocity(command)
    for _ in range(5):
        table.advance(np.zeros(6))
        table.observe()
    assert refused(table.arm.velocity, command)[0] == "command.stale"


@pytest.mark.parametrize("text", ["NEAR(HAND, AND(RED, CUBE))", "NEAR(HAND, NOT(OR(RED, GREEN)))"])
def test_the_shipped_agent_reaches_what_a_program_names(text):
    actor = Actor.of(load_policy(AGENT))
    assert all(Rehearsal(index).execute(text, actor) for index in range(3))


def test_the_shipped_agent_reaches_what_a_camera_finds_by_tags():
    pytest.importorskip("cv2", reason="needs the extra `camera`")
    files = (EXAMPLES / name for name in ("simulated_arm.py", "tag_tracker.py"))
    simulated, tracker = load([*map(str, files)])
    arm, plant = RealArm(load_robot(EXAMPLES / "robot.yaml")), simulated.SimulatedArm(3, tags=True)
    camera, detector = Camera(plant.model, simulated.VIEW, *simulated.SIZE), tracker.finder()
    matrix = intrinsics(plant.model, simulated.VIEW, *simulated.SIZE)
    seen_from, actor = optical_pose(plant.model, simulated.VIEW), Actor.of(load_policy(AGENT))
    arm.submit(ProgramRequest("p", "NEAR(HAND, SPHERE)"))
    program = parse(arm.program, DESIGN.vocabulary)
    for step in range(40):
        stamp, now = step * 10**8, step * PERIOD_S
        joints = plant.data.qpos[:6].copy(), plant.data.qvel[:6].copy()
        arm.joints.add(*joints, stamp, now)
        arm.frames.add("world", "hand", Placed(pose_of(plant.body("hand")), stamp, now))
        arm.frames.add("world", "camera", Placed(pose_of(seen_from)))
        if step % 5 == 0:
            camera.look(plant)
            for number, tag in tracker.find(detector, camera.picture(), matrix).items():
                arm.frames.add("camera", f"tag36h11:{number}", Placed(pose_of(tag), stamp, now))
        observed = arm.observe(now, stamp)
        true = np.linalg.norm(plant.body("hand").position - plant.body("block2").position)
        assert observed.verdict.distance == pytest.approx(true, abs=0.03)
        if true < 0.08:
            break
        wanted = actor.act(observed.observation, program) * arm.about.speed_limits
        plant.velocity = arm.allowed(wanted.astype(np.float64))
        plant.advance(PERIOD_S)
    camera.close()
    assert true < 0.08


def pose_of(body):
    return np.array([*body.position, *body.quaternion])
