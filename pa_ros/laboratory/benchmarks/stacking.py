"""How often an agent builds a tower with a robot that robot_node drives through standard topics:
the simulated arm with its vacuum cup in the place of a real one (docs/robot.md)."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rclpy.action import ActionClient
from rclpy.node import Node
from sensor_msgs.msg import JointState

from laboratory.benchmarks.rehearsal import EXAMPLES, SETTLE_S, START_S, result_of
from pa_ros.acting.execution import HOLD_S
from pa_ros.arena import Kind, ReachTask, design_named, preset_for
from pa_ros.core.clock import now_ns
from pa_ros.core.experience import Body
from pa_ros.core.text import Report
from pa_ros.language import stages
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.executor import release, spin_until, steady_timer
from pa_ros.tools.domain import use_free_domain
from pa_ros.wire.fields import read_array, write_stamp
from pa_ros.wire.program import ProgramGoal
from pa_ros.wire.robot import encode_valve
from pa_ros.wire.views import encode_transforms

DESIGN = design_named("stack-2")
AGENT, CONDITION = "shipped:stack", "tower-4"
PERIOD_S = 0.02  # of the driver
VALVE, HOLDS = "suction/valve", "suction/holds"
WINDOW_S = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--scenes", type=int, default=10, help="one tower each (%(default)s)")
    # From a measurement to the motion: two messages, and half of the driver's period.
    parser.add_argument("--told", type=float, default=0.03, help="arm_delay_s (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """The share of towers of four that stood for a second."""
    import rclpy

    from pa_ros.ros.environment import prepare_environment

    use_free_domain()
    prepare_environment()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.yaml"
        file.write_text(yaml.safe_dump(_described(options.told), sort_keys=False))
        robot = ["sim_node.robot.main", "--ros-args", "-p", f"robot:={file}"]
        agent = ["agent_node.main", "--ros-args", "-p", "weights:=checkpoint"]
        commands = [[*robot, "-p", "autostart:=true"], [*agent, "-p", f"checkpoint:={AGENT}"]]
        rclpy.init()
        arm = StackingArm()
        try:
            started = [subprocess.Popen([sys.executable, "-P", "-m", *one]) for one in commands]
            built = _build(arm, options.scenes)
        finally:
            for process in started:
                process.terminate()
            for process in started:
                process.wait()
            release(arm)
            arm.destroy_node()
            rclpy.shutdown()
    return {"built": sum(built) / len(built), "scenes": len(built)}


class StackingArm(Node):
    """The driver of an arm with a vacuum cup, and what measures the blocks; it knows no agent."""

    def __init__(self) -> None:
        super().__init__("stacking_arm")
        config = preset_for(DESIGN).changed(control_period_s=PERIOD_S)
        self.task = ReachTask(config, DESIGN, seed=0)
        self._command = np.zeros(config.joints + 1)
        self.names = [f"joint_{i}" for i in range(1, config.joints + 1)]
        self._joints, self._tf = topics.JOINT_STATES.publisher(self), topics.TF.publisher(self)
        self._holds = topics.holds(HOLDS).publisher(self)
        self.place(0)
        topics.VELOCITY_COMMANDS.subscribe(self, self._on_velocity)
        topics.valve(VALVE).subscribe(self, self._on_valve)
        steady_timer(self, PERIOD_S, self._step)

    def place(self, scene: int) -> None:
        """Put the blocks where a scene of the arena has them."""
        self._command[:] = 0.0
        self.task.reset(scene, CONDITION)
        kinds = [block.kind for block in self.task.episode.blocks]
        self._bodies = [_name(kind) for kind in kinds]

    def _on_velocity(self, message: Any) -> None:
        self._command[:-1] = read_array("velocity", message.data, np.float64, (len(self.names),))

    def _on_valve(self, message: Any) -> None:
        self._command[-1] = 1.0 if message.data else -1.0

    def _step(self) -> None:
        simulation, now = self.task.simulation, now_ns()
        simulation.advance(self._command)
        state = JointState(name=self.names)
        write_stamp(state.header.stamp, now)
        state.position = simulation.joint_position.tolist()
        state.velocity = simulation.joint_velocity.tolist()
        self._joints.publish(state)
        poses, _ = simulation.body_states()
        placed = {
            name: Body.at_rest(pose[:3], np.roll(pose[3:], -1))
            for name, pose in zip(("hand", *self._bodies), poses, strict=True)
        }
        self._tf.publish(encode_transforms(placed, now))
        self._holds.publish(encode_valve(bool(simulation.hand_pose[-1])))


def _name(kind: Kind) -> str:
    return str(kind).lower().replace(" ", "_")


def _described(arm_delay_s: float) -> dict[str, Any]:
    """The example's robot.yaml with a gripper, and with blocks and places that tf measures."""
    described: dict[str, Any] = yaml.safe_load((EXAMPLES / "robot.yaml").read_text())
    kinds = (*DESIGN.pool, *DESIGN.places)
    return {
        **described,
        "dry_run": False,
        "arm_delay_s": arm_delay_s,
        "design": DESIGN.name,
        "preset": DESIGN.preset,
        "gripper": {"valve": VALVE, "holds": HOLDS},
        "objects": {_name(k): {"words": [*k.values()], "frame": _name(k)} for k in kinds},
    }


def _build(arm: StackingArm, scenes: int) -> list[bool]:
    """Whether each scene's tower is built, as the agent says, and as the arena's verifier does."""
    client, built = ActionClient(arm, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0]), []
    if not spin_until(arm, client.server_is_ready, START_S):
        raise SystemExit(f"expected an agent within {START_S:g} s, got none")
    for scene in range(scenes):
        arm.place(scene)
        spin_until(arm, lambda: False, SETTLE_S)  # until the new scene is measured
        started, task = time.monotonic(), arm.task
        result = result_of(arm, client, ProgramGoal(str(task.goal), WINDOW_S, HOLD_S))
        state = task.simulation.objects(), task.simulation.hand_pose
        stand = [task.verifier_of(one).score(*state).satisfied for one in stages(task.goal)]
        built.append(result.success and all(stand))
        told = "" if result.success else result.reason
        took = time.monotonic() - started
        print(f"scene {scene}: {task.goal}: {built[-1]}, {took:.1f} s {told}", flush=True)
    client.destroy()
    return built
