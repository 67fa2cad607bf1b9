"""What a controller receives keeps the hand in its box and the joints below their speeds, whatever
is lost or wrong on the way."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from helpers.robots import CONFIG, SIMULATED, robot_values
from pa_ros.core.errors import PaError
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.step import Command
from sim_node.robot.arm import COMMAND_TIMEOUT_S, RealArm
from sim_node.robot.frames import Placed
from sim_node.robot.output import RobotOutput
from sim_node.robot.settings import read_robot

TICK_S, PERIOD_TICKS, LATE_TICKS = 0.02, 5, 2
BOX = {"lower": [-0.45, -0.45, 0.15], "upper": [0.45, 0.45, 0.6]}
MARGIN_M = 0.02  # docs/robot.md
LOST = "joints", "hand", "zeros"  # what a sensor does for 1.5 s now and then


class Plant:
    """A simulated arm, what its sensors tell, and a controller that does what it is sent."""

    def __init__(self, clock: Any, control: str, seed: int) -> None:
        self.clock, self.control, self.seed = clock, control, seed
        values = robot_values(workspace=BOX, max_acceleration=2.0, control=control, dry_run=False)
        self.robot, self.plant = RealArm(read_robot(values)), SIMULATED.SimulatedArm(seed)
        self.sent: list[Any] = []
        node = Mock()
        node.create_publisher.return_value = SimpleNamespace(publish=self.sent.append)
        self.output = RobotOutput(node, self.robot)
        self.robot.submit(ProgramRequest("p", "NEAR(HAND, BLUE)"))
        self.asked = 0.0  # rad/s, greatest

    @property
    def outside_m(self) -> float:
        """How far the hand is outside its box; negative: inside."""
        hand = self.plant.body("hand").position
        return float(max((BOX["lower"] - hand).max(), (hand - BOX["upper"]).max()))

    def measure(self, wrong: str) -> None:
        stamp, now = round(self.clock.now * 1e9), self.clock.now
        if wrong != "joints":
            position, velocity = self.plant.data.qpos[:6].copy(), self.plant.data.qvel[:6].copy()
            self.robot.joints.add(position * (wrong != "zeros"), velocity, stamp, now)
        for name, body in {"hand": "hand", **SIMULATED.OBJECTS}.items():
            if wrong != name:
                seen = self.plant.body(body)
                pose = np.array([*seen.position, *seen.quaternion])
                self.robot.frames.add("world", name, Placed(pose, stamp, now))

    def obey(self) -> None:
        """Move for a tick as the newest message says."""
        for message in self.sent:
            if self.control == "joint_trajectory":
                (point,) = message.points
                wanted = (np.array(point.positions) - self.plant.data.qpos[:6]) / 0.1
            else:
                wanted = np.array(getattr(message, "velocities", None) or message.data)
            self.asked = max(self.asked, float(np.abs(wanted).max()))
            self.plant.velocity[:] = wanted
        self.sent.clear()
        self.plant.advance(TICK_S)
        self.clock.now += TICK_S

    def push(self, seconds: float, lose: str = "") -> float:
        """Turn all joints at full speed, ever another way; the farthest that the hand, once inside
        its box, was outside."""
        rng, worst, due = np.random.default_rng(self.seed), -1.0, -1
        commanded, lost_until, loss = -np.inf, -1, None
        for tick in range(round(seconds / TICK_S)):
            if lose and tick >= lost_until and rng.random() < 0.01:
                lost_until = tick + round(1.5 / TICK_S)
            self.measure(lose if tick < lost_until else "")
            if tick % 40 == 0:
                action = rng.choice([-1.0, 1.0], 6).astype(np.float32)
            if tick % PERIOD_TICKS == 0:
                try:
                    loss, due = None, tick + LATE_TICKS
                    self.robot.observe(self.clock.now, round(self.clock.now * 1e9))
                except PaError as error:
                    loss = error
                if loss or self.clock.now - commanded > COMMAND_TIMEOUT_S:
                    self.output.rest()
                else:
                    self.output.keep()
            if tick == due and loss is None:
                seen = self.robot.seen
                command = Command(0, seen.step, seen.stamp_ns, "a", 0, action)
                self.output.send(self.robot.velocity(command))
                commanded = self.clock.now
            self.obey()
            worst = max(worst, self.outside_m) if worst > -1 or self.outside_m < 0 else worst
        return worst


@pytest.fixture
def plant(monkeypatch, clock):
    monkeypatch.setattr("sim_node.robot.output.time.monotonic", clock)
    return lambda control, seed=0: Plant(clock, control, seed)


@pytest.mark.parametrize("control", ["velocity", "joint_trajectory", "joint_jog"])
@pytest.mark.parametrize("lose", ["", *LOST])
def test_the_hand_stays_in_its_box_and_joints_below_their_speeds(plant, control, lose):
    arm = plant(control, seed=3)
    assert -0.05 < arm.push(12.0, lose) < MARGIN_M, "it gets near the box, and not out"
    # A controller of trajectories is asked for more while the arm lags behind its velocity.
    bound = 1.3 if control == "joint_trajectory" else 1.0
    assert 0.5 < arm.asked / max(CONFIG.joint_speed_limits) <= bound


def test_a_trajectory_does_not_run_back_when_joint_states_stop(plant):
    arm = plant("joint_trajectory")
    arm.push(1.0)
    before = np.sign(arm.plant.velocity) * (np.abs(arm.plant.velocity) > 0.2)
    points = []
    for tick in range(60):
        arm.measure("joints")
        if tick % PERIOD_TICKS == 0:
            arm.output.rest()
            points.append(np.array(arm.sent[-1].points[0].positions) if arm.sent else points[-1])
        arm.obey()
    assert before.any() and np.all(np.diff(points, axis=0) * before >= -1e-9)
    assert np.abs(arm.plant.velocity).max() < 0.01, "it rests where the last point was"


@pytest.mark.parametrize(("control", "lasts_s"), [("velocity", 0.25), ("joint_trajectory", 0.1)])
def test_a_velocity_lasts_until_the_relay_ends_it_and_a_trajectory_for_a_period(
    plant, control, lasts_s
):
    believed = plant(control).robot.believed
    believed.sent(np.ones(6), 10.0)
    believed.move(12.0)
    assert believed.position == pytest.approx([lasts_s] * 6)


def test_after_a_silence_the_arm_starts_from_rest(plant, clock):
    arm = plant("velocity")
    arm.push(1.0)
    assert np.abs(arm.output.velocity).max() > 0.5
    clock.now += 1.0
    arm.output.keep()
    assert np.abs(arm.output.velocity).max() <= 2.0 * 0.1 + 1e-9, "one step up the ramp"


def test_what_was_applied_is_the_mean_of_what_was_sent_within_ramp_and_box(plant, clock):
    arm = plant("velocity")
    arm.measure("")
    arm.robot.observe(clock.now, round(clock.now * 1e9))
    arm.output.applied()
    speed = max(CONFIG.joint_speed_limits)
    sent = []
    for _ in range(5):
        arm.output.send(np.array([speed, 0, 0, 0, 0, 0]))
        sent.append(arm.output.velocity.copy())
        clock.now += TICK_S
    assert arm.output.applied() == pytest.approx(np.mean(sent, axis=0) / speed)
    assert 0 < sent[0][0] < sent[-1][0] < speed, "the ramp is slower than the command"
    clock.now += TICK_S
    assert arm.output.applied() == pytest.approx(sent[-1] / speed)
