"""Time from a picture to the command that it led to, at 10 Hz, with all processes on one core."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from laboratory.benchmarks.latency import FEWEST, PERCENTILES, TIMEOUT_S
from laboratory.benchmarks.written import WrittenMessages
from pa_ros.core.errors import PaError
from pa_ros.core.text import Report
from pa_ros.ros import topics
from pa_ros.ros.environment import ros_arguments
from pa_ros.ros.executor import spin_until
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.launcher import Supervisor
from pa_ros.wire import Message
from pa_ros.wire.step import decode_step, step_answered
from pa_ros.wire.views import decode_image

AGENT = "shipped:camera"
CAMERA = {"rate_hz": 10.0, "view": "above", "width": 240, "height": 240}
SCENE = {"design": "3-D", "seed": 2, "mode": "real_time"}
READ = (topics.OBJECT_FEATURES.within("seen"), topics.CAMERA_IMAGE, topics.JOINT_COMMANDS)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--seconds", type=float, default=110.0, help="(%(default)s)")
    parser.add_argument("--warm-up", type=float, default=10.0, help="seconds (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Percentiles in ms, with sim_node, camera_node, an agent and this process on one core."""
    use_free_domain()
    cores, uses = os.sched_getaffinity(0), Uses()
    os.sched_setaffinity(0, {min(cores)})  # children inherit it
    try:
        _measure(uses, options.warm_up, options.seconds)
    finally:
        os.sched_setaffinity(0, cores)
    times = uses.latencies_s
    if not times:
        raise PaError(
            f"camera: expected commands that follow a picture within {options.seconds:g} s, got "
            "none: stop other work, or measure for longer (--seconds)"
        )
    report: Report = {
        f"camera.latency_{name}_ms": float(np.percentile(times, percent)) * 1e3
        for name, percent in PERCENTILES.items()
    }
    return {**report, "camera.pictures": len(times), "camera.unused": len(uses.pictures)}


def _measure(uses: Uses, warm_up_s: float, seconds: float) -> None:
    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("bench") as node:
            written = WrittenMessages(node, READ, uses.heard)
            for module, arguments in _nodes().items():
                supervisor.start(module, [sys.executable, "-m", module, *arguments])
            if not spin_until(node, lambda: len(uses.latencies_s) >= FEWEST, TIMEOUT_S):
                raise PaError(f"camera: expected commands within {TIMEOUT_S:g} s, got too few")
            spin_until(node, lambda: False, warm_up_s)
            uses.latencies_s.clear()
            spin_until(node, lambda: False, seconds)
            supervisor.check()
            written.close()


def _nodes() -> dict[str, list[str]]:
    """Arguments by module."""
    pictures = {f"camera.{name}": value for name, value in CAMERA.items()}
    policy = {"weights": "checkpoint", "checkpoint": AGENT}
    seen = {name: f"seen/{name}" for name in ("object_features", "arena_info")}
    return {
        "sim_node.main": ros_arguments(SCENE | pictures),
        "sim_node.camera.main": ros_arguments({"perception": AGENT}),
        "agent_node.main": ros_arguments(policy, remaps=seen),
    }


@dataclass
class Uses:
    """Which command each picture led to: that of the first step published after the picture."""

    latencies_s: list[float] = field(default_factory=list)
    pictures: dict[int, float] = field(default_factory=dict)  # when written, by stamp
    steps: dict[int, float] = field(default_factory=dict)

    def heard(self, kind: int, message: Message, written_s: float) -> None:
        """A message of a topic of READ was written."""
        self.wrote(kind, _stamp_of(kind, message), written_s)

    def wrote(self, kind: int, stamp_ns: int, now_s: float) -> None:
        """A message of a topic of READ with this stamp was written."""
        if kind < 2:
            (self.steps, self.pictures)[kind].setdefault(stamp_ns, now_s)
        elif (seen_s := self.steps.get(stamp_ns)) is not None:
            used = [stamp for stamp, at_s in self.pictures.items() if at_s < seen_s]
            self.latencies_s += [now_s - self.pictures.pop(stamp) for stamp in used]
            self.steps = {stamp: at_s for stamp, at_s in self.steps.items() if stamp > stamp_ns}


def _stamp_of(kind: int, message: Message) -> int:
    if kind == 0:
        return decode_step(message).observation.stamp_ns
    return decode_image(message)[0] if kind == 1 else step_answered(message)
