"""A robot driver that replaces sim_node: all that an agent needs from a robot (docs/robot.md)."""

import numpy as np
from rclpy.node import Node

from pa_ros.arena import ReachTask, design_named, preset_named  # the simulated "robot": use yours
from pa_ros.arena.task import world_of
from pa_ros.core.experience import Step
from pa_ros.language import parse
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.node_main import run_node
from pa_ros.ros.refusals import Refusals, answer_program
from pa_ros.wire.arena import ENDLESS, describe_robot, encode_arena_info
from pa_ros.wire.program import ProgramRequest, decode_program, encode_program_status
from pa_ros.wire.step import decode_command, encode_joints, encode_step


class Driver(Node):
    def __init__(self) -> None:
        super().__init__("robot_driver")
        arm = preset_named("fast").changed(episode_steps=ENDLESS)
        self.robot = ReachTask(arm, design_named("3-D"), seed=2)
        self.seen, self.verdict = self.robot.reset(0)
        self.words, self.program, self.command = self.robot.design.vocabulary, None, None
        speeds = self.robot.config.joint_speed_limits
        self.speeds = {f"joint_{i}": speed for i, speed in enumerate(speeds, start=1)}
        world = world_of(arm, self.robot.design)
        self.about = describe_robot(world, self.speeds, control_period_s=0.1)
        self.info = topics.ARENA_INFO.publisher(self)
        self.features = topics.OBJECT_FEATURES.publisher(self)
        self.joints = topics.JOINT_STATES.publisher(self)
        self.status = topics.PROGRAM_STATUS.publisher(self)
        self.info.publish(encode_arena_info(self.about))
        self.refusals = Refusals(self.get_logger().warning)
        topics.JOINT_COMMANDS.subscribe(self, self.refusals.guard("command", self.on_command))
        topics.PROGRAM.subscribe(self, self.refusals.guard("program", self.on_program))
        steady_timer(self, 0.1, self.step)

    def on_program(self, message) -> None:
        request = decode_program(message)
        name, stamp_ns = self.get_fully_qualified_name(), self.seen.stamp_ns
        answer = answer_program(request, name, stamp_ns, self.accept, self.refusals)
        self.status.publish(encode_program_status(answer))

    def accept(self, request: ProgramRequest) -> str:
        program = parse(request.text, self.words)
        self.robot.set_program(program, request.program_id)
        self.program = str(program)
        return self.program

    def on_command(self, message) -> None:
        self.command = decode_command(message)

    def step(self) -> None:
        command, self.command = self.command, None  # without a new command the arm stops
        share = np.zeros(len(self.speeds)) if command is None else np.clip(command.action, -1, 1)
        self.seen, self.verdict = self.robot.step(share * np.array(list(self.speeds.values())))
        step = Step(self.seen, self.verdict, self.program or "", arena_id=self.about.arena_id)
        self.joints.publish(encode_joints(self.seen, tuple(self.speeds)))
        self.features.publish(encode_step(step))

    def close(self) -> None:
        pass


if __name__ == "__main__":
    raise SystemExit(run_node("robot_driver", Driver))
