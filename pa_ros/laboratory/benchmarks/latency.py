"""Time from a program to the first command under it, and from an observation to its command."""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rclpy.node import Node

from laboratory.benchmarks.written import WrittenMessages
from pa_ros.arena import design_named
from pa_ros.core.errors import PaError
from pa_ros.core.text import Report
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until, steady_timer
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.graph import start_nodes
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.wire import Message
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import decode_step, step_answered

DESIGN = "3-D"
RATES = {"": "real_time", "fast.": "lockstep"}  # 10 Hz, and as fast as possible
SECONDS = {"": 110.0, "fast.": 30.0}  # at 10 Hz p99.9 needs a thousand steps
# Mean time from one program being obeyed to the next: at any moment of a control period, and less
# than the 50 per second that an arena accepts.
PAUSE_S = {"": 0.1, "fast.": 0.03}
TICK_S, AGAIN_S = 0.005, 1.0
READ = (topics.OBJECT_FEATURES, topics.JOINT_COMMANDS)
TIMEOUT_S, FEWEST = 120.0, 3
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p999": 99.9}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument(
        "--share", type=float, default=1.0, help="of the usual two and a half minutes (%(default)s)"
    )


def run(options: argparse.Namespace) -> Report:
    """Milliseconds, with an arena and an agent as two processes.

    `fast.`: in lockstep, as fast as possible; otherwise at 10 Hz, where a program waits for the
    next control step.
    """
    use_free_domain()
    report: dict[str, float] = {}
    for rate, mode in RATES.items():
        found = measure(mode, SECONDS[rate] * options.share, PAUSE_S[rate])
        report |= {f"latency.{rate}{name}": value for name, value in found.items()}
    return report


@dataclass
class Latencies:
    """Times in seconds, computed from events that are given with the caller's clock."""

    steps: list[float] = field(default_factory=list)  # observation to command
    programs: list[float] = field(default_factory=list)  # program to the first command under it
    _wanted: tuple[str, float] | None = None  # program id, and when it was sent
    _observed: dict[int, tuple[float, str]] = field(default_factory=dict)  # by stamp

    def sent(self, program_id: str, now_s: float) -> None:
        """A program is sent."""
        self._wanted = program_id, now_s

    def observed(self, stamp_ns: int, program_id: str, now_s: float) -> None:
        """An observation under a program. A repeated one counts from the first time."""
        self._observed.setdefault(stamp_ns, (now_s, program_id))

    def commanded(self, stamp_ns: int, now_s: float) -> bool:
        """A command for the step of this stamp; whether it is the first under the sent program."""
        answered = self._observed.get(stamp_ns)
        self._observed = {s: seen for s, seen in self._observed.items() if s > stamp_ns}
        if answered is None:
            return False
        self.steps.append(now_s - answered[0])
        if self._wanted is None or answered[1] != self._wanted[0]:
            return False
        self.programs.append(now_s - self._wanted[1])
        self._wanted = None
        return True

    def figures(self) -> dict[str, float]:
        """Percentiles in ms, and the number of samples."""
        found: dict[str, float] = {}
        for name, times in (("program", self.programs), ("step", self.steps)):
            for percentile, percent in PERCENTILES.items():
                found[f"{name}_{percentile}_ms"] = float(np.percentile(times, percent)) * 1e3
            found[f"{name}s"] = float(len(times))
        return found


class Prober:
    """Sends programs, each some time after the last was obeyed, and records all times."""

    def __init__(self, node: Node, pause_s: float) -> None:
        self._pause_s, self.latencies = pause_s, Latencies()
        self._random = random.Random(0)
        # Each of these names something in any scene.
        words = design_named(DESIGN).vocabulary.words
        self._programs = [f"NEAR(HAND, NOT({word}))" for word in words]
        self._sent, self._due_s = 0, 0.0
        self._publisher = topics.PROGRAM.publisher(node)
        self._written = WrittenMessages(node, READ, self._process)
        steady_timer(node, TICK_S, self._tick)

    def close(self) -> None:
        """Unsubscribe."""
        self._written.close()

    def _tick(self) -> None:
        if time.monotonic() >= self._due_s:
            self._send()

    def _send(self) -> None:
        """Send a program. Without an answer another one follows after AGAIN_S."""
        self._sent += 1
        request = ProgramRequest(f"latency-{self._sent}", self._random.choice(self._programs))
        message = encode_program(request)
        self.latencies.sent(request.program_id, time.time())
        self._due_s = time.monotonic() + AGAIN_S
        self._publisher.publish(message)

    def _process(self, topic: int, message: Message, written_s: float) -> None:
        if READ[topic] is topics.OBJECT_FEATURES:
            seen = decode_step(message).observation
            self.latencies.observed(seen.stamp_ns, seen.program_id, written_s)
        elif self.latencies.commanded(step_answered(message), written_s):
            pause_s = self._random.uniform(0.5, 1.5) * self._pause_s
            self._due_s = time.monotonic() + pause_s


def _parameters(mode: str) -> Parameters:
    scene = {"design": DESIGN, "seed": 2, "program_source": "topic", "mode": mode}
    policy = {"weights": "checkpoint", "checkpoint": f"shipped:{DESIGN}"}
    return {"sim_node": scene, "agent_node": policy}


def measure(mode: str, seconds: float, pause_s: float) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("bench") as node:
            prober = Prober(node, pause_s)
            try:
                start_nodes(supervisor, _parameters(mode), Path(name))
                _wait_until_obeyed(prober, node)
                prober.latencies = Latencies()
                spin_until(node, lambda: False, seconds)
                _wait_until_obeyed(prober, node)
                supervisor.check()
                return prober.latencies.figures()
            finally:
                prober.close()


def _wait_until_obeyed(prober: Prober, node: Node) -> None:
    """Wait until some programs have been obeyed."""
    if not spin_until(node, lambda: len(prober.latencies.programs) >= FEWEST, TIMEOUT_S):
        raise PaError(f"latency: expected commands within {TIMEOUT_S:g} s, got too few")
