"""A real gripper: what switches it, and what says whether it holds something (docs/robot.md)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.action import ActionClient
from rclpy.task import Future

from pa_ros.arena import ArenaError
from pa_ros.ros import topics
from pa_ros.ros.actions import FINGERS
from pa_ros.wire.robot import decode_finger, decode_holds, encode_fingers, encode_valve
from sim_node.robot.output import DRY_RUN
from sim_node.robot.settings import GripperSettings

if TYPE_CHECKING:
    from pa_ros.ros.lifecycle import ManagedNode


class RobotGripper:
    """Switches a valve with each command, or moves fingers when a command changes, and again until
    their driver accepts it."""

    def __init__(
        self,
        node: ManagedNode,
        settings: GripperSettings,
        dry_run: bool,
        listen: Callable[[topics.Topic, Callable[[bytes], None]], None],
        tell: Callable[[bool], None],
    ) -> None:
        """`listen`: hears the bytes of a topic's messages; `tell`: receives whether the gripper
        holds something, as often as it says so."""
        self._settings, self._tell, self._refusals = settings, tell, node.refusals
        self._on: bool | None = None  # what fingers were told last; None: their driver has no order
        self._valve: Any = None
        self._fingers: Any = None
        if settings.valve:
            topic = topics.valve(settings.valve)
            self._valve = (topic.within(DRY_RUN) if dry_run else topic).publisher(node)
        elif not dry_run:
            self._fingers = ActionClient(node, FINGERS, settings.fingers)
        if settings.holds:
            listen(topics.holds(settings.holds), self._on_holds)
        else:
            listen(topics.JOINT_STATES, self._on_joints)

    def check(self) -> None:
        """Raise ArenaError (`robot.gripper`) while fingers have no driver."""
        if self._fingers is not None and not self._fingers.server_is_ready():
            self._on = None
            expected = f"gripper: expected a driver with the action {self._settings.fingers}"
            raise ArenaError(f"{expected}, got none", "robot.gripper")

    def switch(self, on: bool) -> None:
        """Take, or let go."""
        settings = self._settings
        if self._valve is not None:
            self._valve.publish(encode_valve(on))
        elif self._fingers is not None and on != self._on and self._fingers.server_is_ready():
            self._on = on
            gap_m = settings.closed_m if on else settings.open_m
            goal = encode_fingers(gap_m, settings.max_effort)
            self._fingers.send_goal_async(goal).add_done_callback(self._on_answer)

    def lost(self) -> None:
        """Something that the arm needs is lost: keep what is held, unless the file says release."""
        if self._settings.when_lost == "release":
            self.switch(on=False)

    def _on_answer(self, answer: Future) -> None:
        if not answer.result().accepted:
            self._on = None
            why = "expected that the driver takes the goal, got a refusal"
            self._refusals.refuse(self._settings.fingers, ArenaError(why, "robot.gripper"))

    def _on_holds(self, payload: bytes) -> None:
        message = topics.holds(self._settings.holds).parse(payload)
        if message is not None:
            self._tell(decode_holds(message))

    def _on_joints(self, payload: bytes) -> None:
        joint = self._settings.joint
        message = topics.JOINT_STATES.parse(payload, [joint])
        position = None if message is None else decode_finger(message, joint)
        if position is not None:
            self._tell(position > self._settings.holds_above)
