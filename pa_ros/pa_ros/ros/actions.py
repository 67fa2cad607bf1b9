"""Actions: one goal at a time, whose life runs on steady time, whatever the node's clock is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msgs_schema import action
from pa_ros.wire import Message

EXECUTE_PROGRAM = ("execute_program", action.ExecuteProgram)
SIMULATE_STEPS = ("simulate_steps", action.SimulateSteps)

Action = tuple[str, Any]  # name and type


class _SteadyNode:
    """A node to an action server, but for its clock.

    rclpy lets results expire by the node's clock. Under a simulated one that runs fast they are
    gone before they are asked for, or even made (rclpy #1236: a KeyError that ends the node).
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, Clock(clock_type=ClockType.STEADY_TIME)

    def get_clock(self) -> Clock:
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


class _Server(ActionServer):  # type: ignore[misc]
    """rclpy's, with results given when they are there: a task that waits for one would spin.

    It stays as long as its node: the executor's queue may hold events of one that is destroyed,
    and calling back with these ends the process.
    """

    def __init__(self, node: Node, action: Action) -> None:
        self.action = action
        self.goals: dict[bytes, Goal] = {}  # under way, and those that have just ended
        execute: Callable[[Any], None] = lambda handle: None  # noqa: E731
        super().__init__(_SteadyNode(node), action[1], action[0], execute_callback=execute)
        self.rest()

    def rest(self) -> None:
        """Reject goals from now on; those under way are aborted, with an empty result."""
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
    """A node's action servers."""
    return [one for one in node.waitables if isinstance(one, _Server)]


class Goal:
    """One goal that was accepted; ended by the first of `succeed`, `abort` and `cancel`."""

    def __init__(self, server: _Server, handle: Any) -> None:
        self.request = Message(handle.request)
        self.active = True
        self._server, self._handle = server, handle

    @property
    def cancelled(self) -> bool:
        """Whether the client wants it to end."""
        return bool(self._handle.is_cancel_requested)

    def feedback(self, feedback: Message) -> None:
        """Tell the client how it stands."""
        if self.active:
            self._handle.publish_feedback(feedback)

    def succeed(self, result: Message) -> None:
        """End it, reached."""
        self._end(self._handle.succeed, result)

    def abort(self, result: Message) -> None:
        """End it, not reached."""
        self._end(self._handle.abort, result)

    def cancel(self, result: Message) -> None:
        """End it, as its client asked."""
        self._end(self._handle.canceled, result)

    def _end(self, into: Callable[[], None], result: Message) -> None:
        if self.active:
            self.active = False
            into()
            self._server.notify_execute(self._handle, lambda _handle: result)


class GoalServer:
    """Serves an action. `start` gets each goal; a goal is ended by whoever got it.

    `cancel` is called, a turn later, when the client of a goal that is still active asks for that.
    A node's second server of an action takes the place of its first, which is at rest by then.
    """

    def __init__(
        self,
        node: Node,
        action: Action,
        start: Callable[[Goal], None],
        cancel: Callable[[Goal], None],
    ) -> None:
        self._start, self._cancel = start, cancel
        self._node = node
        known = [server for server in servers_of(node) if server.action == action]
        self._server = known[0] if known else _Server(node, action)
        self._server.register_handle_accepted_callback(self._accepted)
        self._server.register_cancel_callback(self._cancelling)
        self._server.register_goal_callback(lambda request: GoalResponse.ACCEPT)

    def _accepted(self, handle: Any) -> None:
        goal, goals = Goal(self._server, handle), self._server.goals
        for done in [key for key, one in goals.items() if not one.active]:
            del goals[done]
        goals[bytes(handle.goal_id.uuid)] = goal
        handle.execute()
        self._start(goal)

    def _cancelling(self, handle: Any) -> CancelResponse:
        goal = self._server.goals.get(bytes(handle.goal_id.uuid))
        if goal is None or not goal.active:
            return CancelResponse.REJECT
        # It is in the state "canceling" only when this has returned.
        self._node.executor.create_task(self._cancel, goal)
        return CancelResponse.ACCEPT
