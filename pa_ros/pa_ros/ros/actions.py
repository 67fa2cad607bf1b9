"""Action servers that work under any clock, for one goal at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatusArray
from control_msgs.action import GripperCommand
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from simulation_interfaces.action import SimulateSteps

from msgs_schema.action import ExecuteProgram
from pa_ros.core.errors import PaError
from pa_ros.ros.refusals import RateLimiter, Refusals
from pa_ros.ros.topics import LATCHED, LATCHED_READER, SERVICE, Topic
from pa_ros.wire import Message

EXECUTE_PROGRAM = ("execute_program", ExecuteProgram)
SIMULATE_STEPS = ("simulate_steps", SimulateSteps)
FINGERS = GripperCommand  # of drivers, by any name
# The states of the goals of all clients
GOALS = Topic(f"{EXECUTE_PROGRAM[0]}/_action/status", GoalStatusArray, LATCHED, LATCHED_READER)

Action = tuple[str, Any]  # name and type
# Wall time. Each change of a goal publishes the states of all goals that are kept, so keeping them
# for rclpy's 15 minutes would let a client that sends many goals slow down the arm.
RESULT_KEPT_S = 60


class _SteadyNode:
    """A node as its action server sees it: with a steady clock.

    rclpy lets results expire by the clock of the node. Under simulation time that runs fast they
    expire before a client asks for them (rclpy #1236: a KeyError that ends the node).
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, Clock(clock_type=ClockType.STEADY_TIME)

    def get_clock(self) -> Clock:
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


class _Server(ActionServer):  # type: ignore[misc]
    """rclpy's action server, which returns a result when there is one.

    rclpy's own would run a task for each goal, which spins while it waits for the result. The
    server lives as long as its node: the executor may have queued events of a destroyed one, and
    serving these ends the process.
    """

    def __init__(self, node: Node, action: Action) -> None:
        self.action = action
        self.goals: dict[bytes, ActionGoal] = {}  # by id: the active ones, and some that have ended
        execute: Callable[[Any], None] = lambda handle: None  # noqa: E731
        super().__init__(
            _SteadyNode(node),
            action[1],
            action[0],
            execute_callback=execute,
            **{f"{one}_service_qos_profile": SERVICE for one in ("goal", "result", "cancel")},
            result_timeout=RESULT_KEPT_S,
        )
        self.rest()

    def rest(self) -> None:
        """Abort active goals with an empty result, and reject goals from now on."""
        self.register_goal_callback(lambda request: GoalResponse.REJECT)
        self.register_handle_accepted_callback(None)
        self.register_cancel_callback(None)
        for goal in self.goals.values():
            goal.abort(Message(self.action[1].Result()))
        self.goals.clear()

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


def servers_of(node: Node) -> list[_Server]:
    """The action servers of a node."""
    return [one for one in node.waitables if isinstance(one, _Server)]


class ActionGoal:
    """An accepted goal. The first call of `succeed`, `abort` or `cancel` ends it."""

    def __init__(self, server: _Server, handle: Any) -> None:
        self.request = Message(handle.request)
        self.active = True
        self._server, self._handle = server, handle

    def feedback(self, feedback: Message) -> None:
        """Send feedback to the client."""
        if self.active:
            self._handle.publish_feedback(feedback)

    def succeed(self, result: Message) -> None:
        """End the goal: it was reached."""
        self._end(self._handle.succeed, result)

    def abort(self, result: Message) -> None:
        """End the goal: it was not reached."""
        self._end(self._handle.abort, result)

    def cancel(self, result: Message) -> None:
        """End the goal: its client cancelled it."""
        self._end(self._handle.canceled, result)

    def _end(self, set_state: Callable[[], None], result: Message) -> None:
        if self.active:
            self.active = False
            set_state()
            self._server.notify_execute(self._handle, lambda _handle: result)


class GoalServer:
    """Serves an action; a second server of a node for the same action replaces the first."""

    def __init__(
        self,
        node: Node,
        refusals: Refusals,
        action: Action,
        start: Callable[[ActionGoal], None],
        cancel: Callable[[ActionGoal], None],
    ) -> None:
        """
        :param start: receives each goal, and has to end it sooner or later.
        :param cancel: called after the client of an active goal has asked to cancel it.
        """
        self._node, self._refusals = node, refusals
        self._start, self._cancel = start, cancel
        self._rate = RateLimiter()
        known = [server for server in servers_of(node) if server.action == action]
        self._server = known[0] if known else _Server(node, action)
        self._server.register_handle_accepted_callback(self._accepted)
        self._server.register_cancel_callback(self._cancelling)
        self._server.register_goal_callback(self._requested)

    def _requested(self, _request: Any) -> GoalResponse:
        try:
            self._rate.check()
        except PaError as error:
            self._refusals.refuse(self._server.action[0], error)
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _accepted(self, handle: Any) -> None:
        goal, goals = ActionGoal(self._server, handle), self._server.goals
        for ended in [key for key, one in goals.items() if not one.active]:
            del goals[ended]
        goals[bytes(handle.goal_id.uuid)] = goal
        handle.execute()
        self._start(goal)

    def _cancelling(self, handle: Any) -> CancelResponse:
        goal = self._server.goals.get(bytes(handle.goal_id.uuid))
        if goal is None or not goal.active:
            return CancelResponse.REJECT
        # The goal's state becomes "canceling" only after this callback, so `cancel` must wait.
        self._node.executor.create_task(self._cancel, goal)
        return CancelResponse.ACCEPT
