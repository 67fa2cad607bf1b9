"""The action execute_program: an agent executes a program as a goal."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from agent_node.acting import ActingNode
from pa_ros.acting.execution import ENDED, Execution, ExecutionWatch
from pa_ros.core.clock import now_ns
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Step
from pa_ros.language import stages
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM, ActionGoal, GoalServer
from pa_ros.ros.executor import steady_timer
from pa_ros.wire import Message
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    ProgramRequest,
    decode_goal,
    decode_program_status,
    encode_goal_feedback,
    encode_goal_result,
    encode_program,
)

ACTION = EXECUTE_PROGRAM[0]
FEEDBACK_S = 0.2  # wall time
RESEND_S = 1.0  # wall time after which a program that no arena answered is sent again
FOREVER_S = 1e9  # simulation time


@dataclass
class _Execution:
    """The goal that is being executed."""

    goal: ActionGoal
    wanted: ProgramGoal
    request: ProgramRequest
    watch: ExecutionWatch
    arena_id: str
    stages: int
    sent_at: float = 0.0  # 0: not sent yet
    answered: bool = False  # by the arena


class ProgramGoals:
    """Executes one goal at a time. The arena's verdicts say whether it is reached."""

    def __init__(self, node: ActingNode) -> None:
        self._node = node
        self._current: _Execution | None = None
        self._served = 0
        self._program_out = topics.PROGRAM.publisher(node)
        self._timer: Any = None
        node.subscribe(topics.PROGRAM_STATUS, self._on_status)
        GoalServer(node, node.refusals, EXECUTE_PROGRAM, self._start, self._cancel)

    def abandon(self) -> None:
        """Abort the goal and hold the arm: the agent was deactivated."""
        if self._current is not None:
            self._node.given_up = self._current.request.program_id
            self._abort("goal.inactive", "the agent was deactivated; the arm holds")

    def observe(self, step: Step) -> None:
        """Take in a step of the arena that the agent follows."""
        current = self._current
        if current is None or step.arena_id != current.arena_id:
            return
        if not current.sent_at:  # from now on no step under the program is missed
            self._send(current)
            return
        execution = current.watch.observe(step)
        if execution is not None:
            self._end(current, execution)

    # Callbacks

    def _start(self, goal: ActionGoal) -> None:
        try:
            wanted = decode_goal(goal.request)
            arena_id, count = self._check(wanted.text)
        except PaError as error:
            self._node.refusals.refuse(ACTION, error)
            position = int(getattr(error, "position", -1))
            refused = GoalResult(False, code=error.code, reason=str(error), position=position)
            goal.abort(encode_goal_result(refused))
            return
        if self._current is not None:
            self._abort("goal.replaced", "another goal")
        self._served += 1
        program_id = f"{self._node.get_name()}-{now_ns()}-{self._served}"
        watch = ExecutionWatch(program_id, wanted.time_limit_s or FOREVER_S, wanted.hold_s)
        request = ProgramRequest(program_id, wanted.text)
        self._current = _Execution(goal, wanted, request, watch, arena_id, count)
        self._timer = steady_timer(self._node, FEEDBACK_S, self._on_timer)

    def _check(self, text: str) -> tuple[str, int]:
        """The arena's id, and how many programs a goal has. Raises PaError for one that can't be
        executed now."""
        node, arena = self._node, self._node.arena
        if not node.active:
            raise PaError(f"{ACTION}: expected an active agent, got {node.state}", "goal.inactive")
        if arena is None or not node.agent.has_weights:
            lacks = "an arena" if arena is None else "weights"
            raise PaError(f"{ACTION}: expected {lacks} before a goal, got none", "goal.unready")
        node.agent.check_world(arena.world)
        goal = node.book.program(text)
        node.agent.check_program(goal)
        return arena.arena_id, len(stages(goal))

    def _cancel(self, goal: ActionGoal) -> None:
        if self._current is not None and self._current.goal is goal:
            self._node.given_up = self._current.request.program_id
            reason = "cancelled; the arm holds"
            self._finish(goal.cancel, GoalResult(False, code="goal.cancelled", reason=reason))

    def _on_status(self, message: Message) -> None:
        current, status = self._current, decode_program_status(message)
        if current is None or status.program_id != current.request.program_id:
            return
        if status.node == self._node.get_fully_qualified_name():
            return
        current.answered = True
        current.watch.accepted(status.stamp_ns)
        if not status.accepted:
            self._abort(status.code, f"{status.node}: {status.reason}", status.position)

    def _on_timer(self) -> None:
        """Send feedback, and the program again; abort if the arena is gone."""
        current, arena = self._current, self._node.arena
        if current is None:
            return
        steps = self._node.resolve_topic_name(topics.OBJECT_FEATURES.name)  # as it is remapped
        gone = self._node.count_publishers(steps) == 0
        if gone or arena is None or arena.arena_id != current.arena_id:
            got = "none" if gone or arena is None else repr(arena.arena_id)
            reason = f"{ACTION}: expected the arena {current.arena_id!r} until the end, got {got}"
            self._node.refusals.refuse(ACTION, PaError(reason, "goal.arena_gone"))
            self._abort("goal.arena_gone", reason)
            return
        if current.sent_at and not current.answered:
            if time.monotonic() - current.sent_at > RESEND_S:
                self._send(current)
        current.goal.feedback(encode_goal_feedback(self._progress(current)))

    # The goal's life

    def _send(self, current: _Execution) -> None:
        current.sent_at = time.monotonic()
        self._program_out.publish(encode_program(current.request))

    def _progress(self, current: _Execution) -> GoalProgress:
        objects: tuple[str, ...] = ()
        relevance: tuple[float, ...] = ()
        agent, arena, seen = self._node.agent, self._node.arena, self._node.seen
        if seen is not None and arena is not None:
            observation = seen[0].observation
            objects = arena.world.schema.labels(observation.objects, observation.hand_index)
            if observation.program_id == current.request.program_id:
                relevance = agent.relevance(*seen)
        watch = current.watch
        how = watch.distance, watch.satisfied, objects, relevance, agent.version
        return GoalProgress(*how, watch.stage, current.stages)

    def _end(self, current: _Execution, execution: Execution) -> None:
        if execution.ended == "held":
            reached = GoalResult(True, time_to_reach_s=execution.reached_s)
            self._finish(current.goal.succeed, reached)
            return
        code, reason = ENDED[execution.ended]
        if execution.ended in ("window", "violated"):
            self._node.given_up = current.request.program_id
        if execution.ended == "window":
            reason = f"{reason} ({current.wanted.time_limit_s:g} s)"
        reached_s = execution.reached_s
        missed = GoalResult(False, time_to_reach_s=reached_s, code=code, reason=reason)
        self._finish(current.goal.abort, missed)

    def _abort(self, code: str, reason: str, position: int = -1) -> None:
        assert self._current is not None
        result = GoalResult(False, code=code, reason=reason, position=position)
        self._finish(self._current.goal.abort, result)

    def _finish(self, end: Callable[[Message], None], result: GoalResult) -> None:
        """End the goal with a result, which gets the distance of the newest step."""
        current, self._current = self._current, None
        assert current is not None
        self._node.destroy_timer(self._timer)
        result = replace(result, final_distance=current.watch.distance)
        end(Message(encode_goal_result(result)))
