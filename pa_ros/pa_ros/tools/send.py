"""Publish a program to everyone in a running graph, and follow it."""

from __future__ import annotations

import time
import uuid
from dataclasses import dataclass, field

from rclpy.node import Node

from pa_ros.acting.execution import HOLD_S, Execution, ExecutionWatch, window_s
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import (
    ARENA_INFO,
    JOINT_COMMANDS,
    OBJECT_FEATURES,
    PROGRAM,
    PROGRAM_STATUS,
)
from pa_ros.tools.client import NoAnswerError, Spin, publishers_of
from pa_ros.wire import Message
from pa_ros.wire.program import (
    ProgramRequest,
    ProgramStatus,
    decode_program_status,
    encode_program,
)
from pa_ros.wire.step import decode_step

FOREVER_S = 1e9
RESEND_S = 1.0
SETTLE_S = 1.0  # until nodes on one machine have found each other


@dataclass
class Answers:
    """The answers to one program, and who has not answered yet."""

    statuses: dict[str, ProgramStatus] = field(default_factory=dict)  # by node
    silent: set[str] = field(default_factory=set)  # nodes that answer programs
    absent: set[str] = field(default_factory=set)  # "an arena", "an agent": none was discovered

    @property
    def refused(self) -> list[ProgramStatus]:
        """The answers that reject the program."""
        return [status for status in self.statuses.values() if not status.accepted]


class ProgramSender:
    """Publishes programs, one at a time, and follows each one.

    A program is sent again while answers are missing, so that a node that starts late gets it.
    """

    def __init__(self, node: Node, spin: Spin, follow: bool = True) -> None:
        """Without `follow` it does not read the arena's steps, which `wait` needs."""
        self._node = node
        self._spin = spin
        self._since = time.monotonic()
        self._program_id = ""
        self.answers = Answers()  # to the program sent last
        self._watch = ExecutionWatch("")
        self._execution: Execution | None = None
        self._stepped_ns, self._stepped_at = -1, self._since  # of the newest step under the program
        self._publisher = PROGRAM.publisher(node)
        self._message: Message | None = None  # the program sent last
        self._sent_at = self._since
        self.refusals = Refusals(node.get_logger().warning)
        read = [(PROGRAM_STATUS, self._on_status), *[(OBJECT_FEATURES, self._on_step)] * follow]
        self._readers = [
            topic.subscribe(node, self.refusals.guard(topic.name, callback))
            for topic, callback in read
        ]

    def close(self) -> None:
        """Leave the topics."""
        for reader in self._readers:
            self._node.destroy_subscription(reader)
        self._node.destroy_publisher(self._publisher)

    def send(
        self,
        text: str,
        timeout_s: float,
        time_s: float | None = None,
        hold_s: float = HOLD_S,
        program_id: str = "",
    ) -> Answers:
        """Publish a program and wait until an arena, an agent and all others have answered.

        Returns at the first refusal. Raises NoAnswerError if a node doesn't answer. `time_s` and
        hold are those of `ExecutionWatch`, for `wait`; by default as long as the goal is given.
        """
        self._program_id = program_id or f"send-{uuid.uuid4().hex[:16]}"
        self.answers, self._execution, self._stepped_ns = Answers(), None, -1
        window = window_s(text) if time_s is None else time_s
        self._watch = ExecutionWatch(self._program_id, window, hold_s)
        self._message = encode_program(ProgramRequest(self._program_id, text))
        self._publish()
        if not self._spin(self._answered, timeout_s):
            missing = ", ".join(sorted(self.answers.silent | self.answers.absent))
            absent = self.answers.absent
            hint = ": does the graph run, in this ROS domain and namespace?" if absent else ""
            raise NoAnswerError(f"no answer within {timeout_s:g} s from {missing}{hint}")
        return self.answers

    def wait(self, patience_s: float) -> Execution:
        """Wait for the outcome of the program sent last. Raises NoAnswerError if the arena takes no
        step under it for so long."""
        self._stepped_at = time.monotonic()

        def over() -> bool:
            silent_s = time.monotonic() - self._stepped_at
            return self._execution is not None or silent_s > patience_s

        self._spin(over, FOREVER_S)
        if self._execution is None:
            raise NoAnswerError(f"no step under the program arrived within {patience_s:g} s")
        return self._execution

    def _publish(self) -> None:
        self._sent_at = time.monotonic()
        self._publisher.publish(self._message)

    def _answered(self) -> bool:
        if self.answers.refused:
            return True
        needed = {"an arena": ARENA_INFO, "an agent": JOINT_COMMANDS}
        found = {who: publishers_of(self._node, topic) for who, topic in needed.items()}
        self.answers.absent = {who for who, nodes in found.items() if not nodes}
        answering = set().union(*found.values(), publishers_of(self._node, PROGRAM_STATUS))
        self.answers.silent = answering - self.answers.statuses.keys()
        unanswered = self.answers.absent or self.answers.silent
        if unanswered and time.monotonic() - self._sent_at > RESEND_S:
            self._publish()
        settled = time.monotonic() - self._since > SETTLE_S
        return settled and not unanswered

    def _on_status(self, message: Message) -> None:
        status = decode_program_status(message)
        if status.program_id == self._program_id:
            self.answers.statuses[status.node] = status

    def _on_step(self, message: Message) -> None:
        if self._execution is None:
            step = decode_step(message)
            self._execution = self._watch.observe(step)
            if self._watch.begun and step.observation.stamp_ns > self._stepped_ns:
                self._stepped_ns, self._stepped_at = step.observation.stamp_ns, time.monotonic()
