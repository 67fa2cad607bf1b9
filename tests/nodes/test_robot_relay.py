"""The relay passes velocities on, and brings the arm to rest when none come."""

import signal
import socket
import subprocess
import sys
import time
from threading import Thread
from typing import Any, cast

import numpy as np
import pytest
import yaml

from helpers.graph import graph
from helpers.processes import node_command
from helpers.robots import SIMULATED, Table, robot_values
from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.core.errors import PaError
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from sim_node.robot import relay
from sim_node.robot.relay import FOUND_S, RESTS, SILENCE_S, TICK_S, Relay, pass_on


class Link:
    """`pass_on` in a thread, and what it published: (time, velocities)."""

    def __init__(self, acceleration: float) -> None:
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.published: list[tuple[float, np.ndarray]] = []
        publish = lambda v: self.published.append((time.monotonic(), v))  # noqa: E731
        self.thread = Thread(target=pass_on, args=(self.far, publish, 2, acceleration), daemon=True)
        self.thread.start()
        assert self.near.recv(100) == b"ready"

    def send(self, *velocity: float, age_s: float = 0.0) -> None:
        frame = np.array([time.monotonic() - age_s, *velocity]).tobytes()
        self.near.send(frame)
        assert self.near.recv(100) == frame

    def ends(self) -> None:
        """Close this end; the other one brings the arm to rest, and ends."""
        self.near.close()
        wait_for(lambda: not self.thread.is_alive())
        self.far.close()
        assert not self.published[-1][1].any()


def test_velocities_are_passed_on_and_a_silence_brings_the_arm_to_rest():
    link = Link(acceleration=4.0)
    link.send(1.0, -0.5)
    heard = time.monotonic()
    zeros = lambda: [t for t, v in link.published if not v.any()]  # noqa: E731
    wait_for(lambda: len(zeros()) > RESTS)
    velocities = np.array([v for _, v in link.published])
    assert velocities[0].tolist() == [1.0, -0.5]
    steps = np.diff(velocities[:, 0])
    assert np.all(steps <= 0) and steps.min() >= -4.0 * TICK_S - 1e-9
    assert velocities[:, 1] == pytest.approx(-velocities[:, 0] / 2), "its direction stays"
    assert link.published[1][0] - heard > SILENCE_S - 0.05
    link.send(0.5, 0.0)
    wait_for(lambda: link.published[-1][1].tolist() == [0.5, 0.0])  # sends again
    link.ends()


def test_a_velocity_from_before_a_silence_is_not_passed_on():
    link = Link(acceleration=0.0)
    link.send(1.0, 1.0, age_s=2 * SILENCE_S)
    link.send(0.0, 0.5)
    link.ends()
    assert [v.tolist() for _, v in link.published[:2]] == [[0.0, 0.5], [0.0, 0.0]]


def test_a_relay_that_does_not_start_is_one_clear_error(monkeypatch, capfd):
    monkeypatch.setattr(relay, "START_S", 5.0)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(PaError, match="died or does not answer: see its output") as error:
        Relay("velocity_commands", "velocity", ["a"], 0.1, 2.0, 0)
    assert error.value.code == "robot.relay"


@pytest.mark.graph
def test_a_relay_waits_for_the_controller_before_it_takes_velocities():
    received: list[float] = []
    with client_node("controller") as node:
        topic = node.resolve_topic_name(topics.VELOCITY_COMMANDS.name)
        started = time.monotonic()
        taken = Relay(topic, "velocity", ["a"], 0.1, 0.0, node.context.get_domain_id())
        assert time.monotonic() - started > FOUND_S, "there is no controller yet"
        topics.VELOCITY_COMMANDS.subscribe(
            node, lambda message: received.extend(cast(Any, message).data)
        )
        spin_until(node, lambda: taken.send(np.array([1.0])) and 1.0 in received, DEADLINE_S)
        taken.close()
    assert 1.0 in received


@pytest.mark.graph
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_the_arm_stops_when_robot_node_does(ros_domain, tmp_path, number):
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(robot_values(dry_run=False, max_acceleration=2.0)))
    arguments = ["--ros-args", "-p", f"robot:={file}", "-p", "autostart:=true"]
    process = subprocess.Popen(node_command("sim_node.robot", *arguments))
    try:
        with graph(SIMULATED.ArmDriver) as probe:
            table = Table(probe)
            assert table.moves()
            process.send_signal(number)
            assert table.stops()
            if number == signal.SIGSTOP:
                process.send_signal(signal.SIGCONT)
                assert table.moves()
    finally:
        process.terminate()
        process.wait(10)
