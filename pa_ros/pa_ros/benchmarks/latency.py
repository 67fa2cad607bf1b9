"""How soon a program is obeyed and a step is answered: `pa_ros bench latency`."""

from __future__ import annotations

import random
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from pa_ros.arena import design_named
from pa_ros.core.errors import PaError
from pa_ros.core.report import Report
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until, steady_timer
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import start_nodes
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.wire import Message
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import decode_step_mark

DESIGN = "3-D"
RATES = {"": "real_time", "fast.": "lockstep"}  # 10 Hz, and as fast as it goes
SECONDS = {"": 110.0, "fast.": 30.0}  # at 10 Hz p99.9 needs a thousand steps
# So long after one program is obeyed comes the next, give or take half of it: at any moment of a
# control period, and fewer than the 50 a second that an arena judges.
PAUSE_S = {"": 0.1, "fast.": 0.03}
TICK_S, AGAIN_S = 0.005, 1.0
DEEP = QoSProfile(depth=10_000)  # what comes while the machine does something else
TIMEOUT_S, FEWEST = 120.0, 3
SHARES = {"p50": 50.0, "p99": 99.0, "p999": 99.9}  # percentiles


class LatencyError(PaError):
    """A graph that did not answer."""

    code = "bench.latency"


@dataclass
class Latencies:
    """Times, s, between what was heard and asked; each noted as of the caller's clock."""

    steps: list[float] = field(default_factory=list)  # observation to command
    programs: list[float] = field(default_factory=list)  # program sent to the first obeying command
    _wanted: tuple[str, float] | None = None  # program id, and when it was sent
    _heard: dict[int, tuple[float, str]] = field(default_factory=dict)  # by stamp

    def asked(self, program_id: str, now_s: float) -> None:
        """A program is being sent."""
        self._wanted = program_id, now_s

    def observed(self, stamp_ns: int, program_id: str, now_s: float) -> None:
        """An observation, under a program. One that is repeated counts from the first time."""
        self._heard.setdefault(stamp_ns, (now_s, program_id))

    def commanded(self, stamp_ns: int, now_s: float) -> bool:
        """A command, by the stamp that it answers; whether it is the first to obey the program."""
        heard = self._heard.get(stamp_ns)
        self._heard = {s: h for s, h in self._heard.items() if s > stamp_ns}
        if heard is None:
            return False
        self.steps.append(now_s - heard[0])
        if self._wanted is None or heard[1] != self._wanted[0]:
            return False
        self.programs.append(now_s - self._wanted[1])
        self._wanted = None
        return True

    def figures(self) -> dict[str, float]:
        """Percentiles, ms, and how many samples they are of."""
        found: dict[str, float] = {}
        for name, times in (("program", self.programs), ("step", self.steps)):
            for share, percent in SHARES.items():
                found[f"{name}_{share}_ms"] = float(np.percentile(times, percent)) * 1e3
            found[f"{name}s"] = float(len(times))
        return found


class Ear:
    """What is said on topics, with the moment when its writer had it ready: a node that no executor
    serves, since rclpy's fast one does not tell that moment."""

    def __init__(self, node: Node, *heard: topics.Topic) -> None:
        self._node = rclpy.create_node(f"{node.get_name()}_ear", namespace=node.get_namespace())
        self._readers = [
            self._node.create_subscription(t.type, t.name, lambda _: None, DEEP) for t in heard
        ]

    def drain(self) -> list[tuple[int, int, Message]]:
        """What has come since: moment (ns, this machine's clock), which topic, message; in order.

        Topics are looked at in the order given: of two, the effect's before the cause's.
        """
        found = []
        for i, reader in enumerate(self._readers):
            with reader.handle:
                while taken := reader.handle.take_message(reader.msg_type, False):
                    found.append((taken[1]["source_timestamp"], i, taken[0]))
        return sorted(found, key=lambda one: one[0])

    def close(self) -> None:
        self._node.destroy_node()


class Person:
    """Sends programs, the next some time after the last was obeyed, and notes all times."""

    def __init__(self, node: Node, pause_s: float) -> None:
        self._pause_s, self.latencies = pause_s, Latencies()
        self._random = random.Random(0)
        # These name something in any scene.
        words = design_named(DESIGN).vocabulary.words
        self._programs = [f"NEAR(HAND, NOT({word}))" for word in words]
        self._sent, self._due_s = 0, 0.0
        self._out = topics.PROGRAM.publisher(node)
        self._ear = Ear(node, topics.JOINT_COMMANDS, topics.OBJECT_FEATURES)
        self.close = self._ear.close
        steady_timer(node, TICK_S, self._tick)

    def _tick(self) -> None:
        for written_ns, topic, message in self._ear.drain():
            self._hear(written_ns * 1e-9, topic == 0, message)
        if time.monotonic() >= self._due_s:
            self.ask()

    def ask(self) -> None:
        """Send a program, and the next in any case after AGAIN_S: nobody may have been there."""
        self._sent += 1
        request = ProgramRequest(f"latency-{self._sent}", self._random.choice(self._programs))
        message = encode_program(request)
        self.latencies.asked(request.program_id, time.time())
        self._due_s = time.monotonic() + AGAIN_S
        self._out.publish(message)

    def _hear(self, written_s: float, is_command: bool, message: Message) -> None:
        stamp_ns = header_stamp(message)
        if not is_command:
            program_id = decode_step_mark(message).program_id
            self.latencies.observed(stamp_ns, program_id, written_s)
        elif self.latencies.commanded(stamp_ns, written_s):
            pause_s = self._random.uniform(0.5, 1.5) * self._pause_s
            self._due_s = time.monotonic() + pause_s


def bench_latency(share: float = 1.0, conditions: tuple[str, ...] = ("", "training.")) -> Report:
    """Milliseconds from a program that is sent to the first command that obeys it, and from an
    observation to its command, each as of the moment when its writer gave it to DDS: how long the
    process that measures has to wait for its own turn doesn't count. Arena and agent are two
    processes; with `training.` another one learns besides. At 10 Hz a program waits for the next
    control step; with `fast.` in lockstep, as fast as it goes. `share` of the usual time is
    measured."""
    use_domain(None)
    report: dict[str, float] = {}
    for condition in conditions:
        for rate, mode in RATES.items():
            found = _measure(mode, SECONDS[rate] * share, PAUSE_S[rate], condition != "")
            report |= {f"{condition}latency.{rate}{name}": value for name, value in found.items()}
    return report


def _parameters(mode: str) -> Parameters:
    scene = {"design": DESIGN, "seed": 2, "program_source": "topic", "mode": mode}
    policy = {"weights": "checkpoint", "checkpoint": f"shipped:{DESIGN}"}
    return {"sim_node": scene, "agent_node": policy}


def _measure(mode: str, seconds: float, pause_s: float, training: bool) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        if training:
            _train(supervisor, Path(name))
        with client_node("bench") as node:
            person = Person(node, pause_s)
            try:
                start_nodes(supervisor, _parameters(mode), Path(name))
                _obeyed(person, node)
                person.latencies = Latencies()
                spin_until(node, lambda: False, seconds)
                _obeyed(person, node)
                supervisor.check()
                return person.latencies.figures()
            finally:
                person.close()


def _obeyed(person: Person, node: Node) -> None:
    """Wait for some programs, at least, that were obeyed."""
    if not spin_until(node, lambda: len(person.latencies.programs) >= FEWEST, TIMEOUT_S):
        raise LatencyError(f"latency: expected commands within {TIMEOUT_S:g} s, got too few")


def _train(supervisor: Supervisor, folder: Path) -> None:
    """Start a learner that trains in a process of its own; it learns when this returns."""
    rows, until = folder / "run" / "progress.csv", time.monotonic() + TIMEOUT_S
    options = ["--design", "2-L", "--frames", str(10**8), "--out", str(rows.parent)]
    rarely = ["--eval-every", "1000", "--eval-episodes", "1"]
    supervisor.start("train", [sys.executable, "-m", "pa_ros", "train", *options, *rarely])
    while not rows.exists() or len(rows.read_text().splitlines()) < 2:
        supervisor.check()
        if time.monotonic() > until:
            raise LatencyError(f"latency: expected a learner within {TIMEOUT_S:g} s, got none")
        time.sleep(0.1)
