"""A simulated arm with its driver and an agent that pushes the hand at its box, in a thread."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from threading import Thread
from typing import Any, Final

import mujoco
import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

from chaos.pusher import LIMITS, Pusher
from helpers.robots import SIMULATED
from pa_ros.core.experience import Float64
from pa_ros.ros import topics
from pa_ros.ros.executor import node_beside, take_messages
from pa_ros.wire.fields import header_stamp, write_stamp, write_vector
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import Command, encode_command
from pa_ros.wire.views import encode_transforms

PERIOD_S: Final = 0.02  # of the driver
TICK_S: Final = 0.01  # of the physics, and between two samples
HOUR: Final = 3600  # s
STALL_S: Final = 0.2  # a pause of this process that is worth a note
AT_REST: Final = 0.02  # rad/s
REST_S: Final = 0.3  # at rest for so long; an arm that turns back, or waits for a late point of a
# trajectory, is slow for less
DETECTED, CLASS = "blue_cylinder", "cylinder"  # the object that `detections` measure


@dataclass
class Sent:
    """What the sensors and the agent send at one time. Faults change it."""

    joints: JointState
    tf: TFMessage
    detections: Detection3DArray
    number: int
    more: list[bytes] = field(default_factory=list)  # further messages on tf
    lost: set[str] = field(default_factory=set)  # "joint_states", "joint_commands"


Spoil = Callable[[Sent], object]


def unspoilt(_: Sent) -> None:
    """Change nothing."""


@dataclass
class Record:
    """The worst that the arm did."""

    outside_m: float = -np.inf  # how far the hand was outside its box
    commanded: float = 0.0  # share of the speed limits
    real: float = 0.0
    rest_s: float = 0.0  # until the arm was at rest after a fault
    stall_s: float = 0.0  # of this process

    def add(self, other: Record) -> None:
        """Keep the worse of two."""
        for name, value in vars(other).items():
            setattr(self, name, max(getattr(self, name), value))

    def __str__(self) -> str:
        stalled = f", observer stalled for {self.stall_s:.2f} s" if self.stall_s > STALL_S else ""
        return (
            f"{self.outside_m * 1e3:.1f} mm outside the box, {self.commanded:.3f} of the speed "
            f"limit commanded, {self.real:.3f} real, at rest after {self.rest_s:.2f} s{stalled}"
        )


class PushedArm:
    """Publishes joint_states, tf and detections, answers observations, and moves as commanded.

    Commands take effect when they were sent, so a stall of this process changes nothing.
    """

    def __init__(self, node: Node, control: str, box: tuple[Float64, Float64], seed: int) -> None:
        self.record, self.moves = Record(), 0
        self._spoil: Spoil = unspoilt
        self._arm, self._control, self._box = SIMULATED.SimulatedArm(), control, box
        self._left_s = 0.0  # until the point of a trajectory is reached
        # Each tick: time (s), greatest speed, hand [3], joints' positions, velocities, commands.
        self.trace: deque[Float64] = deque(maxlen=2000)
        self._pusher = Pusher(self._arm, box, seed)
        self._commands: deque[tuple[float, Any]] = deque()
        self._count, self._number, self._asked_s = 0, 0, 0.0
        self._node = beside = node_beside(node, "arm")
        self._joints, self._tf, self._detections, self._answers, self._programs = (
            topic.publisher(beside)
            for topic in (topics.JOINT_STATES, topics.TF, topics.DETECTIONS, topics.JOINT_COMMANDS,
                          topics.PROGRAM)
        )  # fmt: skip
        self._setpoints, self._features = (
            topic.subscribe(beside, lambda _: None)
            for topic in (topics.SETPOINTS[control], topics.OBJECT_FEATURES)
        )
        self._at_s, self._ended = time.monotonic(), False
        self._thread = Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        self._node.destroy_node()

    @property
    def speed(self) -> float:
        """Of the fastest joint, rad/s."""
        return float(np.abs(self._arm.data.qvel[:6]).max())

    def spoil_with(self, spoil: Spoil) -> None:
        """Let a fault change what is sent from now on."""
        self._spoil = spoil

    def rest(self, since_s: float) -> tuple[float | None, bool]:
        """After how many seconds the arm came to rest, and whether it stayed there."""
        moved_s, samples = since_s, [row[:2] for row in list(self.trace) if row[0] > since_s]
        for i, (at, speed) in enumerate(samples):
            moved_s = at if speed > AT_REST else moved_s
            if at - moved_s > REST_S:
                return moved_s - since_s, all(speed < AT_REST for _, speed in samples[i:])
        return None, False

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ended:
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            self.record.stall_s = max(self.record.stall_s, now - due)
            if now - due > PERIOD_S:  # the middleware was stalled, too, and may need a moment
                time.sleep(PERIOD_S)
            due = max(due + PERIOD_S, now)
            for message, info in take_messages(self._setpoints):
                # A fault may set the sender's clock, by whole hours.
                age_s = (time.time_ns() - info["source_timestamp"]) / 1e9 % HOUR
                self._commands.append((time.monotonic() - age_s, message))
            while (step_s := self._next_step(now)) > 0.0:
                self._advance(step_s)
            self._send()

    # The arm

    def _next_step(self, now_s: float) -> float:
        """How far to advance, after the commands of this time; s. The physics knows only ticks, but
        a trajectory's point changes the motion when it is sent."""
        while self._commands and self._commands[0][0] <= self._at_s:
            self._take(self._commands.popleft()[1])
        if self._control != "joint_trajectory":
            return TICK_S if self._at_s + TICK_S <= now_s else 0.0
        until_s = min([now_s, *(at for at, _ in self._commands)])
        return min(TICK_S, until_s - self._at_s)

    def _advance(self, step_s: float) -> None:
        self._at_s += step_s
        if self._control == "joint_trajectory":
            self._approach(step_s)
        else:
            self._arm.advance(step_s)
        share = np.abs(self._arm.data.qvel[:6]) / LIMITS
        hand, (lower, upper) = self._arm.body("hand").position, self._box
        outside = max((lower - hand).max(), (hand - upper).max())
        self.record.add(Record(float(outside), real=float(share.max())))
        state = self._arm.data.qpos[:6], self._arm.data.qvel[:6], self._arm.velocity
        self.trace.append(np.concatenate([[self._at_s, self.speed], hand, *state]))
        self.moves += self.speed > AT_REST

    def _take(self, message: Any) -> None:
        """Do what a setpoint says."""
        if self._control == "joint_trajectory":
            (point,), here = message.points, self._arm.data.qpos[:6]
            period = point.time_from_start
            self._left_s = period.sec + period.nanosec / 1e9
            velocity = (np.array(point.positions) - here) / self._left_s
        else:
            values = message.data if self._control == "velocity" else message.velocities
            velocity = np.array(values)
        share = float(np.max(np.abs(velocity) / LIMITS))
        self.record.add(Record(commanded=share if np.isfinite(share) else np.inf))
        self._arm.velocity[:] = np.nan_to_num(velocity)

    def _approach(self, step_s: float) -> None:
        """Move the joints by position control: to the point in its time, and no further."""
        data, moved_s = self._arm.data, min(step_s, self._left_s)
        self._left_s -= moved_s
        data.qvel[:6] = self._arm.velocity if self._left_s > 0.0 else 0.0
        data.qpos[:6] += self._arm.velocity * moved_s
        mujoco.mj_forward(self._arm.model, data)

    # Its sensors, and the agent

    def _send(self) -> None:
        sent = self._measured()
        self._spoil(sent)
        if "joint_states" not in sent.lost:
            self._joints.publish(sent.joints)
        for message in (sent.tf, *sent.more):
            self._tf.publish(message)
        self._detections.publish(sent.detections)
        seen = [message for message, _ in take_messages(self._features)]
        if seen and "joint_commands" not in sent.lost:
            self._answer(seen[-1])

    def _measured(self) -> Sent:
        data, now = self._arm.data, time.time_ns()
        state = JointState(name=[f"joint_{i}" for i in range(1, 7)])
        write_stamp(state.header.stamp, now)
        state.position, state.velocity = data.qpos[:6].tolist(), data.qvel[:6].tolist()
        bodies = {name: self._arm.body(body) for name, body in SIMULATED.OBJECTS.items()}
        seen = Detection3DArray(detections=[_detection(bodies.pop(DETECTED))])
        write_stamp(seen.header.stamp, now)
        seen.header.frame_id = "world"
        poses = encode_transforms({"hand": self._arm.body("hand"), **bodies}, now)
        self._number += 1
        return Sent(state, poses, seen, self._number)

    def _answer(self, message: Any) -> None:
        """Command what pushes the hand; ask for a program where none runs."""
        now = time.monotonic()
        if not message.program and now - self._asked_s > 1.0:
            self._asked_s = now
            self._programs.publish(encode_program(ProgramRequest("p", "NEAR(HAND, BLUE)")))
        self._count += 1
        action, stamp = self._pusher.action(now).astype(np.float32), header_stamp(message)
        command = Command(0, message.step, stamp, "pusher", 0, action, 1, self._count)
        self._answers.publish(encode_command(command))


def _detection(body: Any) -> Detection3D:
    """A sure detection of an object at the pose of a body."""
    guess = ObjectHypothesisWithPose()
    guess.hypothesis.class_id, guess.hypothesis.score = CLASS, 1.0
    write_vector(guess.pose.pose.position, body.position)
    write_vector(guess.pose.pose.orientation, body.quaternion, "xyzw")
    return Detection3D(results=[guess])


@cache
def crowd(frames: int) -> bytes:
    """A message of tf with so many frames that nobody wants."""
    link = TransformStamped(child_frame_id="somebody's_link")
    link.header.frame_id = "somebody's_base"
    return bytes(serialize_message(TFMessage(transforms=[link] * frames)))
