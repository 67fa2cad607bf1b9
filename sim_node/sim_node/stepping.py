"""The action simulate_steps: a paused arena advances step by step, and can be cancelled between.

Each step is the answer of the agent, as in lockstep. Without a program, or an agent, the arm holds.
"""

from __future__ import annotations

from typing import Any

from pa_ros.core.errors import PaError
from pa_ros.ros.actions import SIMULATE_STEPS, ActionGoal, GoalServer
from pa_ros.ros.executor import steady_timer
from pa_ros.wire import Message
from pa_ros.wire.simulator import (
    ResultCode,
    decode_simulation_steps,
    encode_steps_feedback,
    encode_steps_result,
)
from sim_node.running import ArenaNode
from sim_node.session import SimulatorError

ROUND_S = 0.001  # wall time between two steps, in which the node serves other callbacks


class SteppingAction:
    """Executes one goal at a time; a second one is aborted."""

    def __init__(self, arena: ArenaNode) -> None:
        self._arena = arena
        self._goal: ActionGoal | None = None
        self._steps = self._done = 0
        self._timer: Any = None
        GoalServer(arena, arena.refusals, SIMULATE_STEPS, self._start, self._cancel)

    @property
    def awaits_command(self) -> bool:
        """Whether the next step is up to the agent."""
        return self._goal is not None and self._arena.has_agent

    def count(self) -> None:
        """Report a step that was made, and end the goal with the last one."""
        goal = self._goal
        if goal is None:
            return
        self._done += 1
        goal.feedback(Message(encode_steps_feedback(self._done, self._steps - self._done)))
        if self._done == self._steps:
            self._end()
            self._arena.samples.show()
            goal.succeed(Message(encode_steps_result(ResultCode.OK)))

    def _start(self, goal: ActionGoal) -> None:
        try:
            self._arena.check_paused()
            steps = decode_simulation_steps(goal.request)
            if self._goal is not None:
                text = f"simulate_steps: expected one goal at a time, got one after {self._done}"
                raise SimulatorError(f"{text} steps of another", ResultCode.OPERATION_FAILED)
        except PaError as error:
            self._abort(goal, error)
            return
        self._goal, self._steps, self._done = goal, steps, 0
        self._timer = steady_timer(self._arena, ROUND_S, self._step)
        if self.awaits_command:
            self._arena.show()  # so that the agent answers it, perhaps once more

    def _step(self) -> None:
        goal = self._goal
        if goal is None:
            return
        try:
            self._arena.check_paused()
            if self.awaits_command:
                return
            self._arena.hold(1)
        except PaError as error:
            self._end()
            self._abort(goal, error)
            return
        self.count()

    def _cancel(self, goal: ActionGoal) -> None:
        if goal is self._goal:
            self._end()
            text = f"cancelled after {self._done} of {self._steps} steps"
            goal.cancel(Message(encode_steps_result(ResultCode.OPERATION_FAILED, text)))

    def _end(self) -> None:
        self._goal = None
        self._arena.destroy_timer(self._timer)

    def _abort(self, goal: ActionGoal, error: PaError) -> None:
        self._arena.refusals.refuse(SIMULATE_STEPS[0], error)
        goal.abort(Message(encode_steps_result(ResultCode.OPERATION_FAILED, str(error))))
