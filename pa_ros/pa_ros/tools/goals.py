"""A program as a goal of a running agent: sent, followed, cancelled."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.action import ActionClient
from rclpy.node import Node

from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.executor import spin_until
from pa_ros.tools.send import SendTimeoutError, Spin
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    decode_goal_feedback,
    decode_goal_result,
    encode_goal,
)

CANCEL_S = 5.0
AGAIN_S = 0.5
UNREADY = "goal.unready"
REJECTED = "goal.rejected"
TAKES_NONE = (
    "the agent takes no goals now: is it configured and active? (ros2 lifecycle get, with its name)"
)


class GoalClient:
    """The action execute_program in a node's namespace."""

    def __init__(self, node: Node, spin: Spin | None = None) -> None:
        """`spin` serves callbacks until a condition holds or a time is up; whether it holds."""
        self._spin = spin or partial(spin_until, node)
        self._client = ActionClient(node, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])

    def offered(self, timeout_s: float) -> bool:
        """Whether an agent offers the action, or comes to within a time."""
        return self._spin(self._client.server_is_ready, timeout_s)

    def close(self) -> None:
        """Call before the node is destroyed."""
        self._client.destroy()

    def execute(
        self,
        goal: ProgramGoal,
        timeout_s: float,
        progress: Callable[[GoalProgress], None] = lambda _: None,
    ) -> GoalResult:
        """Have a goal pursued to its end. Whatever ends this early cancels it: the arm then holds.

        An agent that has just started, and knows no arena or weights yet, is asked again. One that
        takes no goals, or ends this one without a result, gives the code REJECTED.
        Raises SendTimeoutError when the goal isn't taken up, or has no result, within the time.
        """
        until = time.monotonic() + timeout_s
        while True:
            result = self._attempt(goal, timeout_s, progress)
            if result.code != UNREADY or time.monotonic() > until:
                return result
            self._spin(lambda: False, AGAIN_S)

    def _attempt(
        self, goal: ProgramGoal, timeout_s: float, progress: Callable[[GoalProgress], None]
    ) -> GoalResult:
        sent = self._client.send_goal_async(
            encode_goal(goal),
            feedback_callback=lambda m: progress(decode_goal_feedback(m.feedback)),
        )
        if not self._spin(sent.done, timeout_s):
            raise SendTimeoutError(f"no agent took the goal up within {timeout_s:g} s")
        handle: Any = sent.result()
        if not handle.accepted:
            return GoalResult(False, code=REJECTED, reason=TAKES_NONE)
        result = handle.get_result_async()
        try:
            if not self._spin(result.done, timeout_s):
                raise SendTimeoutError(f"it is still being executed after {timeout_s:g} s")
        finally:
            if not result.done():
                self._spin(handle.cancel_goal_async().done, CANCEL_S)
        ended = decode_goal_result(result.result().result)
        if not ended.success and not ended.code:
            return GoalResult(False, code=REJECTED, reason=TAKES_NONE)
        return ended
