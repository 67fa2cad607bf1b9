"""Two phases of a demonstration on the graph: watching it learn, and having it execute programs.

What is learned and which scenes are asked for is the caller's affair.
"""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from pa_ros.acting.execution import WINDOW_S, Execution
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Verdict
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import VERDICT
from pa_ros.tools.arena_client import ArenaClient
from pa_ros.tools.graph import watch
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures
from pa_ros.tools.send import ProgramSender
from pa_ros.wire import Message
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import decode_verdict, is_evaluation

READY_S, ANSWER_S = 60.0, 30.0  # wall time that a node has to start, and to answer


class NotReadyError(PaError):
    """Nodes that were started but don't work together in time."""

    code = "demo.not_ready"


class ProgramRefusedError(PaError):
    """A program of the demonstration that a node refused."""

    code = "demo.refused"


def hear_verdicts(node: Node, receive: Callable[[Verdict, bool], object]) -> None:
    """Call back with each verdict, and whether it is of an evaluation episode."""

    def decode(message: Message) -> None:
        receive(decode_verdict(message), is_evaluation(message))

    refusals = Refusals(node.get_logger().warning)
    VERDICT.subscribe(node, refusals.guard(VERDICT.name, decode))


class Executor:
    """Has a running graph execute programs, one scene each."""

    def __init__(
        self,
        node: Node,
        supervisor: Supervisor,
        figures: GraphFigures,
        interrupted: Callable[[], bool],
        real_time_factor: float,
    ) -> None:
        self._node, self._supervisor = node, supervisor
        self._figures, self._interrupted = figures, interrupted
        self._patience_s = ANSWER_S + 2.0 * WINDOW_S / real_time_factor
        self._arena = ArenaClient(node, self._spin)
        self._sender = ProgramSender(node, self._spin)

    def wait_until_ready(self) -> None:
        """Wait until the arena runs and the agent has weights; NotReadyError if they don't."""
        if not self._spin(self._ready, READY_S):
            raise NotReadyError(f"arena and agent: expected them to work within {READY_S:g} s")

    def execute(self, text: str, scene: ResetRequest) -> Execution:
        """Put a scene up, send the program while time stands still, and see what becomes of it.

        Raises ArenaServiceError, ProgramRefusedError, SendTimeoutError, ChildError, and
        KeyboardInterrupt if a signal came.
        """
        self._arena.pause(True, ANSWER_S)
        self._arena.reset(scene, ANSWER_S)
        answers = self._sender.send(text, ANSWER_S)
        for judgement in answers.refused:
            raise ProgramRefusedError(f"{judgement.node}: {judgement.reason}")
        self._arena.pause(False, ANSWER_S)
        return self._sender.wait(self._patience_s)

    def _ready(self) -> bool:
        version = self._figures.value("agent_node", "policy_version")
        stands = self._figures.value("sim_node", "episode")
        return stands is not None and version is not None and version >= 0

    def _spin(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        watch(
            self._node,
            self._supervisor,
            lambda: None,
            lambda: condition() or self._interrupted(),
            timeout_s,
        )
        if self._interrupted():
            raise KeyboardInterrupt
        return condition()
