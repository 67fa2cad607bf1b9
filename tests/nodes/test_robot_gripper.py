"""robot_node drives a gripper: a valve or fingers; what it holds is heard, and never dropped."""

from typing import Any

import numpy as np
import pytest
import yaml
from control_msgs.action import GripperCommand
from rclpy.action import ActionServer, GoalResponse
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from helpers.graph import Probe, graph
from helpers.robots import SIMULATED, Rehearsal, robot_values
from pa_ros.arena import ArenaError
from pa_ros.core.errors import ConfigError
from pa_ros.ros import topics
from pa_ros.ros.topics import STEP, Topic
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.robot import decode_holds
from pa_ros.wire.step import Command, encode_command
from pa_ros.world.relation import GRIP_M
from sim_node.robot.node import RobotNode
from sim_node.robot.settings import read_robot

HOLDS: dict[str, Any] = {"preset": "hold", "design": "stack-2"}
VALVE = {"valve": "suction", "holds": "suction_holds"}
FINGERS = {"fingers": "fingers", "joint": "finger", "open_m": 0.07, "max_effort": 5.0}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({**HOLDS}, "gripper: expected how it is driven, as the preset hold"),
        ({"gripper": VALVE}, "gripper: expected none, as the preset fast"),
        ({**HOLDS, "gripper": {"valve": "v"}}, "expected exactly one of holds and joint"),
        ({**HOLDS, "gripper": {**VALVE, "fingers": "f"}}, "exactly one of valve and fingers"),
        ({**HOLDS, "gripper": {**VALVE, "when_lost": "drop"}}, "when_lost"),
    ],
)
def test_a_gripper_is_described_where_the_preset_has_one(changes: Any, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        read_robot(robot_values(**changes))


def test_the_observation_says_what_the_gripper_says() -> None:
    rehearsal = Rehearsal(**HOLDS, gripper=VALVE)
    with pytest.raises(ArenaError, match="nothing heard yet of suction_holds") as error:
        rehearsal.observe()
    assert error.value.code == "robot.gripper"
    for holds in (False, True):
        rehearsal.arm.holds = holds
        assert rehearsal.observe().observation.hand_pose[7:].tolist() == [float(holds)]
    rehearsal.arm.submit(ProgramRequest("p", "HOLD(HAND, AND(RED, CUBE))"))
    command = rehearsal.command([1.0, 0, 0, 0, 0, 0, 1.0])
    assert rehearsal.arm.velocity(command) == pytest.approx([1.5, 0, 0, 0, 0, 0])


def test_what_a_slow_arm_holds_is_seen_where_it_will_be() -> None:
    late = Rehearsal(**HOLDS, gripper=VALVE, arm_delay_s=0.1)
    late.arm.holds = False
    standing = late.observe().observation
    away = np.linalg.norm(standing.objects[1:, :3] - [0.0, 0.0, GRIP_M], axis=1)
    nearest = 1 + int(away.argmin())
    moves = []
    for holds in (False, True):
        late.arm.holds = holds
        late.arm.believed.sent(np.array([0.4, 0.2, -0.3, 0.1, 0.2, 0.5]), late.now_s)
        late.now_s += 0.1
        late.measure()
        ahead = late.observe().observation
        moves.append(np.linalg.norm(ahead.objects[:, :3] - standing.objects[:, :3], axis=1))
    assert min(moves[0][1:]) > 0.01
    assert moves[1][nearest] < 1e-6  # it goes with the hand
    assert min(np.delete(moves[1], [0, nearest])) > 0.01


class Fingers(Node):  # type: ignore[misc]
    """Fingers with an action, as a driver of ros2_control has them."""

    def __init__(self) -> None:
        super().__init__("driver_of_fingers")
        self.goals: list[Any] = []
        self.refuses = 0  # so many goals
        self.joints = topics.JOINT_STATES.publisher(self)
        self.offer()

    def offer(self) -> None:
        """Take goals."""
        given = GripperCommand, "fingers", self.execute
        self.server = ActionServer(self, *given, goal_callback=self.consider)

    def consider(self, _: Any) -> Any:
        self.refuses -= 1
        return GoalResponse.ACCEPT if self.refuses < 0 else GoalResponse.REJECT

    def close(self) -> None:
        """Nothing runs beside the executor."""

    def execute(self, goal: Any) -> Any:
        self.goals.append((goal.request.command.position, goal.request.command.max_effort))
        goal.succeed()
        return GripperCommand.Result(reached_goal=True)


class LateFingers(Fingers):
    """Their driver starts after robot_node, and refuses twice."""

    offers = False

    def offer(self) -> None:
        if self.offers:
            super().offer()
        self.offers, self.refuses = True, 2


class Hand:
    """Commands the gripper of a robot_node as an agent does."""

    def __init__(self, probe: Probe) -> None:
        self.probe, self.count, self.grip = probe, 0, -1.0
        self.holds: list[float] = []
        self.commands = probe.speaker(topics.JOINT_COMMANDS)
        topics.OBJECT_FEATURES.subscribe(probe, self.answer)
        programs = probe.speaker(topics.PROGRAM)
        programs.publish(encode_program(ProgramRequest("p", "HOLD(HAND, AND(RED, CUBE))")))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > 0)

    def answer(self, message: Any) -> None:
        self.count += 1
        self.holds.append(message.hand_pose[7])
        action = np.array([0.0] * 6 + [self.grip], np.float32)
        answered = message.step, header_stamp(message)
        self.commands.publish(encode_command(Command(0, *answered, "a", 0, action, 1, self.count)))


def robot(tmp_path: Any, gripper: dict[str, Any]) -> dict[str, Any]:
    file = tmp_path / "robot.yaml"
    described = robot_values(dry_run=False, **HOLDS, gripper=gripper)
    file.write_text(yaml.safe_dump(described, sort_keys=False))
    return {"robot_node__robot": file, "robot_node__autostart": True}


@pytest.mark.graph
@pytest.mark.parametrize("when_lost", ["keep", "release"])
def test_a_valve_follows_commands_and_stays_when_the_arm_is_lost(tmp_path, when_lost):
    gripper = {**VALVE, "when_lost": when_lost}
    with graph(RobotNode, SIMULATED.ArmDriver, **robot(tmp_path, gripper)) as probe:
        heard: list[bool] = []
        Topic("suction", Bool, STEP, STEP).subscribe(probe, lambda m: heard.append(decode_holds(m)))
        holds = Topic("suction_holds", Bool, STEP, STEP).publisher(probe)
        assert probe.until(lambda: "suction_holds" in probe.message("robot_node"))
        holds.publish(Bool(data=True))
        hand = Hand(probe)
        assert probe.until(lambda: heard[-1:] == [False] and hand.holds[-1] == 1.0)
        hand.grip = 1.0
        assert probe.until(lambda: heard[-1])
        driver = probe.nodes[-1]
        driver.joints.publish = lambda _: None
        assert probe.until(lambda: "joint_states" in probe.message("robot_node"))
        assert probe.until(lambda: not heard[-1], 1.0) == (when_lost == "release")


@pytest.mark.graph
def test_fingers_close_and_open_once_and_a_finger_says_what_they_hold(tmp_path):
    given = robot(tmp_path, FINGERS)
    with graph(RobotNode, SIMULATED.ArmDriver, Fingers, **given) as probe:
        *_, fingers = probe.nodes
        fingers.joints.publish(JointState(name=["finger"], position=[0.02]))
        hand = Hand(probe)
        assert probe.until(lambda: len(fingers.goals) == 1 and hand.holds[-1] == 1.0)
        hand.grip = 1.0
        assert probe.until(lambda: len(fingers.goals) == 2)
        assert fingers.goals == [(0.07, 5.0), (0.0, 5.0)]
        fingers.joints.publish(JointState(name=["finger"], position=[0.001]))
        assert probe.until(lambda: hand.holds[-1] == 0.0)
        assert len(fingers.goals) == 2
        large = JointState(name=["finger"] * 10_000, position=[0.05] * 10_000)
        fingers.joints.publish(large)  # is not read: it would keep the node from commanding the arm
        assert probe.until(lambda: int(probe.value("robot_node", "refused.robot.size") or 0) == 2)
        assert hand.holds[-1] == 0.0


@pytest.mark.graph
def test_fingers_are_told_until_they_accept_and_the_arm_holds_while_they_have_no_driver(tmp_path):
    given = robot(tmp_path, FINGERS)
    with graph(RobotNode, SIMULATED.ArmDriver, LateFingers, **given) as probe:
        *_, fingers = probe.nodes
        fingers.joints.publish(JointState(name=["finger"], position=[0.001]))
        expected = "gripper: expected a driver with the action fingers, got none"
        assert probe.until(lambda: expected in probe.message("robot_node"))
        fingers.offer()
        Hand(probe)
        assert probe.until(lambda: fingers.refuses < 0 and fingers.goals == [(0.07, 5.0)])
        refused = "refused.robot.gripper"
        assert probe.until(lambda: int(probe.value("robot_node", refused) or 0) >= 2)
        fingers.server.destroy()
        assert probe.until(lambda: expected in probe.message("robot_node"))
        fingers.offer()
        assert probe.until(lambda: len(fingers.goals) == 2)
