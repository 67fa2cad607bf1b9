"""A custom controller that replaces agent_node (docs/robot.md)."""

from pathlib import Path

from rclpy.node import Node

from pa_ros.acting.executing import Actor
from pa_ros.language import stages
from pa_ros.learning.checkpoints import load_policy
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.ros.refusals import Refusals, answer_program
from pa_ros.wire.arena import decode_arena_info
from pa_ros.wire.program import decode_program, encode_program_status
from pa_ros.wire.program_book import ProgramBook
from pa_ros.wire.step import Command, decode_step, encode_command


class Controller(Node):
    def __init__(self) -> None:
        super().__init__("controller")
        self.policy = Actor.of(load_policy(Path("shipped:3-D")))  # put yours here
        self.arena = self.book = None
        self.commands = topics.JOINT_COMMANDS.publisher(self)
        self.status = topics.PROGRAM_STATUS.publisher(self)
        self.refusals = Refusals(self.get_logger().warning)
        for topic, react in (
            (topics.ARENA_INFO, self.on_arena),
            (topics.PROGRAM, self.on_program),
            (topics.OBJECT_FEATURES, self.on_step),
        ):
            topic.subscribe(self, self.refusals.guard(topic.name, react))

    def on_arena(self, message) -> None:
        self.arena = decode_arena_info(message)
        self.book = ProgramBook(self.arena.world.vocabulary)

    def on_program(self, message) -> None:
        if self.book is not None:
            name = self.get_fully_qualified_name()
            request = decode_program(message)
            answer = answer_program(request, name, 0, self.book.accept, self.refusals)
            self.status.publish(encode_program_status(answer))

    def on_step(self, message) -> None:
        if self.arena is None:
            return
        step = decode_step(message, len(self.arena.joint_names))
        seen = step.observation
        if step.program:
            stage = step.verdict.stage if step.verdict else 0  # of a goal over time
            program = stages(self.book.program(step.program))[stage]
            action = self.policy.act(seen, program)  # [J], shares of the joints' speed limits
            answered = seen.episode, seen.step, seen.stamp_ns
            command = Command(*answered, "my-controller", self.policy.version, action, 1, seen.step)
            self.commands.publish(encode_command(command))

    def close(self) -> None:
        pass


if __name__ == "__main__":
    raise SystemExit(run_node("controller", Controller))
