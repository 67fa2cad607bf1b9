"""Ping-pong: the messages of a control step between two processes, without nodes.

An upper bound for the graph: the same types, sizes, quality of service and executor, but no
encoding (the messages are made once), no checks and no accounting. One side steps the physics and
the other computes the actor's networks once: the least that a control step needs, whatever rules of
executing and verifying are added to it. So a graph that becomes slower falls behind it.
`python -m laboratory.benchmarks.pingpong` is the side that answers.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import mujoco
import numpy as np

from laboratory.benchmarks.samples import sample_step
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.learning.recipes import LearningSettings
from pa_ros.native.engine import FusedActor
from pa_ros.networks.parameters import initial_actor
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.wire.step import encode_command, encode_step

WARM_UP = 200  # round trips
SETTLE_S = 0.5


def physics_and_networks() -> tuple[Callable[[], object], Callable[[], object]]:
    """One control period of the arena's physics, and one pass through the actor's networks."""
    task = ReachTask(preset_named("fast"), design_named("2-L"), seed=0)
    seen, _ = task.reset(0)
    network = LearningSettings().network.for_world(task.world)
    actor = FusedActor(network, initial_actor(network, np.random.default_rng(0)))
    inputs = seen.objects, task.world.arm(seen), task.program, seen.hand_index
    simulation = task.simulation
    simulation.data.ctrl[:] = 0.1
    step = partial(mujoco.mj_step, simulation.model, simulation.data, task.config.substeps)
    return step, partial(actor.act, *inputs)


def measure_round_trips(
    node: Any, work: Callable[[], object], seconds: float, timeout_s: float
) -> float:
    """Round trips per second with an answering process, over `seconds`; 0 if no process answers.

    `work` is called before each question.
    """
    from pa_ros.ros.executor import spin_until

    question = encode_step(sample_step()[0])
    asking = _bare(topics.OBJECT_FEATURES).publisher(node)
    answers, started, ended = 0, 0.0, 0.0

    def receive(_: object) -> None:
        nonlocal answers, started, ended
        answers += 1
        ended = time.perf_counter()
        if answers == WARM_UP:
            started = ended
        work()
        asking.publish(question)

    answering = _bare(topics.JOINT_COMMANDS).subscribe(node, receive)
    spin_until(
        node, lambda: asking.get_subscription_count() and answering.get_publisher_count(), timeout_s
    )
    spin_until(node, lambda: False, SETTLE_S)  # until the other side has discovered us too
    asking.publish(question)
    # A single spin: between two of them a message could be missed.
    finished = spin_until(node, lambda: bool(started) and ended - started > seconds, timeout_s)
    return (answers - WARM_UP) / (ended - started) if finished else 0.0


def _bare(topic: topics.Topic) -> topics.Topic:
    return replace(topic, name=f"bare/{topic.name.strip('/')}")


def _answerer(work: Callable[[], object]) -> Any:
    from rclpy.node import Node

    class Answerer(Node):
        """Answers every step with the same command."""

        def __init__(self) -> None:
            super().__init__("pingpong")
            self._command = encode_command(sample_step()[1])
            self._writer = _bare(topics.JOINT_COMMANDS).publisher(self)
            _bare(topics.OBJECT_FEATURES).subscribe(self, self._answer)

        def _answer(self, _: object) -> None:
            work()
            self._writer.publish(self._command)

        def close(self) -> None:
            """Nothing to save."""

    return Answerer()


if __name__ == "__main__":
    _, networks = physics_and_networks()
    sys.exit(run_node("pingpong", partial(_answerer, networks), arguments=()))
