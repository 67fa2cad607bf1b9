"""Sending a program to a running graph, hearing who accepts it, and what becomes of it."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from pydantic import Field
from rclpy.node import Node

from pa_ros.acting.execution import HOLD_S, WINDOW_S, Execution, ExecutionWatch
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.settings import Settings
from pa_ros.ros.executor import spin_until
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import ARENA_INFO, JOINT_COMMANDS, PROGRAM, PROGRAM_STATUS, VERDICT, Topic
from pa_ros.wire import Message
from pa_ros.wire.program import (
    LONGEST_S,
    ProgramRequest,
    ProgramStatus,
    decode_program_status,
    encode_program,
)
from pa_ros.wire.step import decode_verdict

RESEND_S = 1.0
SETTLE_S = 1.0  # in which nodes on one machine find each other

Spin = Callable[[Callable[[], bool], float], bool]


class SendOptions(Settings):
    """How to send."""

    timeout_s: float = Field(
        30.0, gt=0, description="seconds to wait for the answers, and again for the verdict"
    )
    wait: bool = Field(False, description="make it a goal of the agent's, and wait for the verdict")
    time_limit_s: float = Field(
        WINDOW_S,
        ge=0,
        le=LONGEST_S,
        description="simulation time that a goal is given; 0: no limit",
    )
    hold_s: float = Field(
        HOLD_S,
        ge=0,
        le=LONGEST_S,
        description="simulation time for which a goal must stay satisfied",
    )


class SendTimeoutError(PaError):
    """Nobody, or not everybody, answered in time; or no verdict came."""

    code = "send.timeout"


@dataclass
class Answers:
    """Who said what to one program, and who has not spoken yet."""

    judgements: dict[str, ProgramStatus] = field(default_factory=dict)  # by node
    silent: set[str] = field(default_factory=set)  # nodes that judge programs
    absent: set[str] = field(default_factory=set)  # "an arena", "an agent": none was discovered

    @property
    def refused(self) -> list[ProgramStatus]:
        """The refusals among the judgements."""
        return [judgement for judgement in self.judgements.values() if not judgement.accepted]


class ProgramSender:
    """Publishes programs from a node, one at a time, and follows each.

    A program is sent again while answers are missing, so a node that starts late hears it. What
    can't be read is refused.
    """

    def __init__(self, node: Node, spin: Spin | None = None) -> None:
        """`spin` serves callbacks until a condition holds or a time is up; whether it holds."""
        self._node = node
        self._spin = spin or partial(spin_until, node)
        self._since = time.monotonic()
        self._program_id = ""
        self.answers = Answers()  # to the program sent last
        self._watch = ExecutionWatch("")
        self._execution: Execution | None = None
        self._publisher = PROGRAM.publisher(node)
        self._message: Message | None = None  # the program sent last
        self._sent_at = self._since
        self.refusals = Refusals(node.get_logger().warning)
        for topic, callback in ((PROGRAM_STATUS, self._on_status), (VERDICT, self._on_verdict)):
            topic.subscribe(node, self.refusals.guard(topic.name, callback))

    def send(self, text: str, timeout_s: float) -> Answers:
        """Publish a program and wait until every node that judges programs has answered.

        At least an arena and an agent must be among them. Returns at the first refusal. Raises
        SendTimeoutError if someone stays silent, ConfigError for text that cannot be sent at all.
        """
        self._program_id = f"send-{uuid.uuid4().hex[:16]}"
        self.answers, self._execution = Answers(), None
        self._watch = ExecutionWatch(self._program_id)
        self._message = encode_program(ProgramRequest(self._program_id, sendable(text)))
        self._publish()
        if not self._spin(self._answered, timeout_s):
            raise SendTimeoutError(_silence(self.answers, timeout_s))
        return self.answers

    def wait(self, timeout_s: float) -> Execution:
        """Wait for what becomes of the program sent last; SendTimeoutError if it stays open."""
        if not self._spin(lambda: self._execution is not None, timeout_s):
            begun = "it is still being executed" if self._watch.begun else "no verdict on it came"
            raise SendTimeoutError(f"{begun} after {timeout_s:g} s")
        assert self._execution is not None
        return self._execution

    def _publish(self) -> None:
        self._sent_at = time.monotonic()
        self._publisher.publish(self._message)

    def _answered(self) -> bool:
        if self.answers.refused:
            return True
        needed = {"an arena": ARENA_INFO, "an agent": JOINT_COMMANDS}
        found = {who: self._publishers(topic) for who, topic in needed.items()}
        self.answers.absent = {who for who, nodes in found.items() if not nodes}
        judges = set().union(*found.values(), self._publishers(PROGRAM_STATUS))
        self.answers.silent = judges - self.answers.judgements.keys()
        unanswered = self.answers.absent or self.answers.silent
        if unanswered and time.monotonic() - self._sent_at > RESEND_S:
            self._publish()
        settled = time.monotonic() - self._since > SETTLE_S
        return settled and not unanswered

    def _publishers(self, topic: Topic) -> set[str]:
        """Full names of the nodes that publish a topic, as far as they have been discovered."""
        return {
            f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            for info in self._node.get_publishers_info_by_topic(topic.name)
        }

    def _on_status(self, message: Message) -> None:
        judgement = decode_program_status(message)
        if judgement.program_id == self._program_id:
            self.answers.judgements[judgement.node] = judgement

    def _on_verdict(self, message: Message) -> None:
        if self._execution is None:
            self._execution = self._watch.observe(decode_verdict(message))


def sendable(text: str) -> str:
    """The same text; ConfigError if it cannot travel."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ConfigError(f"program: expected text in UTF-8: {error}") from error
    return text


def _silence(answers: Answers, timeout_s: float) -> str:
    names = ", ".join(sorted(answers.silent | answers.absent))
    hint = ": does the graph run, in this ROS domain and namespace?" if answers.absent else ""
    return f"no answer within {timeout_s:g} s from {names}{hint}"
