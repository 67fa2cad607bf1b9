"""A small process between robot_node and the arm's controller, which stops the arm when robot_node
dies, is stopped or is too busy.

A forward controller keeps the last velocity for ever. So robot_node hands its velocities to this
process, which sends them on, and brings the arm to rest once it has heard nothing for SILENCE_S.
It does nothing else, so nothing else can keep it from doing so.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from select import select

import numpy as np

from pa_ros.core.errors import PaError
from pa_ros.core.experience import Float64
from pa_ros.world.velocity import VelocityRamp

SILENCE_S = 0.25  # without a setpoint for so long, the arm comes to rest
TICK_S = 0.02  # between two setpoints on the way to rest
RESTS = 8  # setpoints that say "stop" once the arm is at rest, in case one is lost
START_S, CLOSE_S = 20.0, 1.0  # greatest times until a new process answers, and an old one ends
FOUND_S = 3.0  # in which DDS finds the controller, if there is one
LARGEST_FRAME = 4096  # bytes
FAILED = "the process that passes commands on to the arm died or does not answer"


class Relay:
    """robot_node's end: starts the process, hands it velocities, and replaces it if it fails.

    A frame is a packet of the time (s, monotonic) and the velocities [J] (rad/s, as the driver
    counts them), in float64. The process answers each.
    """

    def __init__(self, topic: str, form: str, joints: Sequence[str], period_s: float,
                 acceleration: float, domain: int) -> None:  # fmt: skip
        """Start the process, and wait for it. Raises PaError (`robot.relay`) if it does not start.

        :param topic: of the controller, resolved.
        :param form: of the setpoints (`topics.SETPOINTS`), but not a trajectory.
        :param acceleration: rad/s² of the ramp to rest; 0: at once.
        """
        self._arguments = json.dumps([topic, form, list(joints), period_s, acceleration, domain])
        self._start()
        select([self._link], [], [], START_S)
        self._read()
        if not self.ready:
            self.close()
            raise PaError(f"{FAILED}: see its output above", "robot.relay")

    def _start(self) -> None:
        self._link, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-P", "-m", "sim_node.robot.relay", self._arguments]
        # A session of its own, so that Ctrl-C in a terminal does not end it before robot_node.
        self.process = subprocess.Popen(command, stdin=far.fileno(), start_new_session=True)
        far.close()
        self._link.setblocking(False)
        self.ready, self._started_at = False, time.monotonic()
        self._unanswered_at: float | None = None  # when the first frame without answer was sent

    def check(self) -> None:
        """Replace a process that died or hangs. Raises PaError (`robot.relay`) until it answers."""
        self._read()
        now = time.monotonic()
        silent_s = now - (self._unanswered_at or now)
        if self.ready and self.process.poll() is None and silent_s <= SILENCE_S:
            return
        if self.ready or now - self._started_at > START_S:
            self.ready = False
            self.close()
            self._start()
        raise PaError(f"{FAILED}: another one starts", "robot.relay")

    def send(self, velocity: Float64) -> bool:
        """Hand on velocities [J]; whether the process is there to take them."""
        if self.ready:
            now = time.monotonic()
            with suppress(OSError):  # it died or hangs, which `check` notices
                self._link.send(np.array([now, *velocity]).tobytes())
            self._unanswered_at = self._unanswered_at or now
        return self.ready

    def close(self) -> None:
        """End the process, which brings the arm to rest; kill it if that takes too long."""
        self._link.close()
        try:
            self.process.wait(CLOSE_S if self.ready else 0.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.ready = False

    def _read(self) -> None:
        with suppress(OSError):  # nothing more to read
            while self._link.recv(LARGEST_FRAME):
                self.ready, self._unanswered_at = True, None


def pass_on(
    link: socket.socket, publish: Callable[[Float64], None], joints: int, acceleration: float
) -> None:
    """Publish the velocities that arrive, and bring the arm to rest when none do. Return when the
    other end is gone and the arm is at rest."""
    ramp = VelocityRamp([1.0] * joints, acceleration)
    heard_at, rests, gone = time.monotonic(), 0, False
    link.send(b"ready")
    while rests or not gone:
        readable, _, _ = select([] if gone else [link], [], [], TICK_S if rests else None)
        now = time.monotonic()
        if readable:
            sent_at, *velocity = _next_frame(link)
            gone = not velocity
            # An older frame is from before robot_node was stopped for a while.
            if velocity and now - sent_at <= SILENCE_S:
                ramp.velocity, heard_at, rests = np.array(velocity), now, RESTS
                publish(ramp.velocity)
        elif gone or now - heard_at > SILENCE_S:
            if not ramp.moving:
                rests -= 1
            publish(ramp.towards(np.zeros(joints), TICK_S))


def _next_frame(link: socket.socket) -> Float64:
    """The next frame, answered; without velocities if the other end is gone."""
    try:
        frame = link.recv(LARGEST_FRAME)
        link.send(frame)
    except OSError:
        frame = b""
    return np.frombuffer(frame) if frame else np.zeros(1)


def main() -> int:
    """Run until robot_node is gone."""
    from rclpy import create_node, shutdown

    from pa_ros.ros import topics
    from pa_ros.ros.environment import prepare_environment, start_ros
    from pa_ros.wire.views import encode_setpoint

    topic, form, joints, period_s, acceleration, domain = json.loads(sys.argv[1])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends after robot_node
    prepare_environment()
    start_ros([], domain=domain)
    node = create_node("robot_relay", enable_rosout=False, start_parameter_services=False)
    setpoints = topics.SETPOINTS[form]
    out = node.create_publisher(setpoints.type, topic, setpoints.writer)
    # What is sent before DDS has found the controller is lost, and robot_node must not rely on it.
    until_s = time.monotonic() + FOUND_S
    while not out.get_subscription_count() and time.monotonic() < until_s:
        time.sleep(TICK_S)
    nowhere = np.zeros(len(joints))  # these forms have no positions

    def publish(velocity: Float64) -> None:
        out.publish(encode_setpoint(form, joints, nowhere, velocity, period_s, time.time_ns()))

    with socket.socket(fileno=sys.stdin.fileno()) as link:
        pass_on(link, publish, len(joints), acceleration)
    node.destroy_node()
    shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
