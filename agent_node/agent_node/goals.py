"""The action execute_program: a program as a goal, pursued by an agent that executes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from agent_node.acting import Acting
from agent_node.errors import ArenaGoneError, GoalError, InactiveError
from pa_ros.acting.execution import Execution, ExecutionWatch
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Observation, Verdict
from pa_ros.language import Program, parse
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM, Goal, GoalServer
from pa_ros.ros.executor import steady_timer
from pa_ros.wire import Message
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    decode_goal,
    decode_program_status,
    encode_goal_feedback,
    encode_goal_result,
    encode_program,
)
from pa_ros.wire.program import ProgramRequest as Request
from pa_ros.wire.step import arena_of, decode_verdict

FEEDBACK_S = 0.2  # wall time
RESEND_S = 1.0  # wall time; a program that no arena has judged is sent again
FOREVER_S = 1e9  # simulation time
ENDED = {
    "window": ("goal.time_limit", "the time limit came first"),
    "episode": ("goal.episode_ended", "the arena's episode ended"),
    "replaced": ("goal.replaced", "another program, or another scene, took its place"),
}


@dataclass
class _Pursuit:
    """A goal under way."""

    goal: Goal
    wanted: ProgramGoal
    request: Request
    watch: ExecutionWatch
    sent_at: float | None = None
    arena: str = ""  # whose verdict was the newest until its program was heard
    judged: bool = False
    verdict: Verdict | None = None  # the newest under this program


class ProgramGoals:
    """One goal at a time. What the agent is to know of the arena comes from its verdicts."""

    def __init__(self, node: Node, acting: Acting) -> None:
        self._node, self._acting = node, acting
        self._agent, self._refusals = acting.agent, acting.refusals
        self._current: _Pursuit | None = None
        self._held = ""  # id of a program that is not to be pursued any more
        self._served = 0
        self._heard = ""  # the arena of the newest verdict; empty: none was heard
        self._program_out = topics.PROGRAM.publisher(node)
        self._verdicts: Any = None  # from the first goal on: nobody else needs them
        self._timer: Any = None
        status = topics.PROGRAM_STATUS
        status.subscribe(node, self._refusals.guard(status.name, self._on_status))
        GoalServer(node, EXECUTE_PROGRAM, self._start, self._cancel)

    def abandon(self) -> None:
        """The agent is not active any more: the goal ends, and its program is pursued no more."""
        if self._current is not None:
            self._held = self._current.request.program_id
            error = InactiveError("the agent was deactivated; the arm holds")
            self._finish(self._current.goal.abort, code=error.code, reason=str(error))

    def gave_up(self, program_id: str) -> bool:
        """Whether to hold the arm under a program: its goal was cancelled, or took too long."""
        return program_id == self._held != ""

    def _on_status(self, message: Message) -> None:
        current = self._current
        judgement = decode_program_status(message)
        if current is None or judgement.program_id != current.request.program_id:
            return
        if judgement.node == self._node.get_fully_qualified_name():
            return
        current.judged = True
        current.watch.accepted(judgement.stamp_ns)
        if not judgement.accepted:
            self._finish(
                current.goal.abort,
                code=judgement.code,
                reason=f"{judgement.node}: {judgement.reason}",
                position=judgement.position,
            )

    def _check(self, text: str) -> None:
        """A PaError for a program that can't be executed now."""
        if not self._acting.active:
            raise InactiveError("execute_program: expected an active agent, got one that is not")
        arena = self._acting.arena
        if arena is None or not self._agent.has_weights:
            lacks = "an arena" if arena is None else "weights"
            raise GoalError(f"execute_program: expected {lacks} before a goal, got none")
        self._agent.check_world(arena.world)
        self._agent.check_program(parse(text, arena.world.vocabulary))

    def _start(self, goal: Goal) -> None:
        try:
            wanted = decode_goal(goal.request)
            self._check(wanted.text)
        except PaError as error:
            self._refusals.refuse(EXECUTE_PROGRAM[0], error)
            position = int(getattr(error, "position", -1))
            refused = GoalResult(False, code=error.code, reason=str(error), position=position)
            goal.abort(encode_goal_result(refused))
            return
        if self._current is not None:
            self._finish(self._current.goal.abort, code=ENDED["replaced"][0], reason="another goal")
        self._served += 1
        program_id = f"{self._node.get_name()}-{time.time_ns()}-{self._served}"
        watch = ExecutionWatch(program_id, wanted.time_limit_s or FOREVER_S, wanted.hold_s)
        self._current = _Pursuit(goal, wanted, Request(program_id, wanted.text), watch)
        if self._verdicts is None:
            self._verdicts = topics.VERDICT.subscribe(
                self._node, self._refusals.guard(topics.VERDICT.name, self._on_verdict)
            )
        if self._heard:
            self._send()
        self._timer = steady_timer(self._node, FEEDBACK_S, self._tell)

    def _send(self) -> None:
        """Put the program in force; its verdicts will be heard from the first on."""
        assert self._current is not None
        self._current.sent_at = time.monotonic()
        self._current.arena = self._heard
        self._program_out.publish(encode_program(self._current.request))

    def _on_verdict(self, message: Message) -> None:
        self._heard, current = arena_of(message), self._current
        if current is None:
            return
        if current.sent_at is None:
            self._send()
            return
        if not (current.judged or current.watch.begun):
            current.arena = self._heard  # started anew meanwhile, perhaps; it is sent again
        if self._heard != current.arena:
            self._lose(current, f"verdicts of the arena {current.arena!r}", repr(self._heard))
            return
        verdict = decode_verdict(message)
        execution = current.watch.observe(verdict)
        if verdict.program_id == current.request.program_id:
            current.verdict = verdict
        if execution is not None:
            self._end(current, execution)

    def _end(self, current: _Pursuit, execution: Execution) -> None:
        if execution.ended == "held":
            self._finish(current.goal.succeed, True, execution.reached_s)
            return
        code, reason = ENDED[execution.ended]
        if execution.ended == "window":
            self._held = current.request.program_id
            reason = f"{reason} ({current.wanted.time_limit_s:g} s)"
        self._finish(current.goal.abort, False, execution.reached_s, code, reason)

    def _cancel(self, goal: Goal) -> None:
        current = self._current
        if current is not None and current.goal is goal:
            self._held = current.request.program_id
            self._finish(goal.cancel, code="goal.cancelled", reason="cancelled; the arm holds")

    def _tell(self) -> None:
        """Feedback; and whether there still is an arena that could hear."""
        current = self._current
        if current is None:
            return
        verdicts = self._node.resolve_topic_name(topics.VERDICT.name)  # as it is remapped
        if self._node.count_publishers(verdicts) == 0:
            self._lose(current, "an arena that sends verdicts", "none")
            return
        unheard = current.sent_at is not None and not current.judged
        if unheard and time.monotonic() - (current.sent_at or 0.0) > RESEND_S:
            self._send()
        current.goal.feedback(encode_goal_feedback(self._progress(current)))

    def _lose(self, current: _Pursuit, expected: str, got: str) -> None:
        """The arena that was to execute the program is not there any more."""
        error = ArenaGoneError(f"execute_program: expected {expected}, got {got}")
        self._refusals.refuse(EXECUTE_PROGRAM[0], error)
        self._finish(current.goal.abort, code=error.code, reason=str(error))

    def _relevance(self, observation: Observation, program: Program) -> tuple[float, ...]:
        """Empty where the weights at hand have no degrees, which is refused."""
        try:
            return self._agent.relevance(observation, program)
        except PaError as error:
            self._refusals.refuse(EXECUTE_PROGRAM[0], error)
            return ()

    def _progress(self, current: _Pursuit) -> GoalProgress:
        objects: tuple[str, ...] = ()
        relevance: tuple[float, ...] = ()
        seen, arena = self._acting.seen, self._acting.arena
        if seen is not None and arena is not None:
            objects = arena.world.schema.labels(seen[0].objects, seen[0].hand_index)
            if seen[0].program_id == current.request.program_id:
                relevance = self._relevance(*seen)
        verdict = current.verdict
        distance = verdict.distance if verdict else float("inf")
        near = verdict is not None and verdict.satisfied
        return GoalProgress(distance, near, objects, relevance, self._agent.version)

    def _finish(
        self,
        end: Callable[[Message], None],
        success: bool = False,
        reached_s: float | None = None,
        code: str = "",
        reason: str = "",
        position: int = -1,
    ) -> None:
        current, self._current = self._current, None
        assert current is not None
        self._node.destroy_timer(self._timer)
        distance = current.verdict.distance if current.verdict else float("inf")
        result = GoalResult(success, distance, reached_s, code, reason, position)
        end(Message(encode_goal_result(result)))
