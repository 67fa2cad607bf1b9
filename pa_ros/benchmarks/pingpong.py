"""Bare ping-pong: the messages of a control step between two processes, and nothing else.

An upper bound for the graph: the same types, sizes, quality of service and executor, but no arena,
no policy and no encoding (the messages are made once). `python -m benchmarks.pingpong` is the side
that answers.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

from benchmarks.samples import sample_step
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.wire.step import encode_command, encode_step

WARM_UP = 200  # round trips
SETTLE_S = 0.5


def measure_round_trips(
    node: Any, seconds: float, timeout_s: float = 30.0, work_us: float = 0.0
) -> float:
    """Round trips per second with an answering process, over `seconds`; 0 if no process answers.

    `work_us` is spent computing before each question, so that what a pause does to the transport
    (colder caches, sleeping threads and cores) is part of the round trip.
    """
    from pa_ros.ros.executor import spin_until

    question = encode_step(sample_step()[0])
    asking = _bare(topics.OBJECT_FEATURES).publisher(node)
    answers, started, ended = 0, 0.0, 0.0

    def receive(_: object) -> None:
        nonlocal answers, started, ended
        answers += 1
        ended = time.perf_counter()
        while time.perf_counter() - ended < work_us * 1e-6:
            pass
        if answers == WARM_UP:
            started = ended
        asking.publish(question)

    answering = _bare(topics.JOINT_COMMANDS).subscribe(node, receive)
    spin_until(
        node,
        lambda: asking.get_subscription_count() and answering.get_publisher_count(),
        timeout_s,
    )
    spin_until(node, lambda: False, SETTLE_S)  # until the other side has discovered us too
    asking.publish(question)
    # A single spin: between two of them a message could be missed.
    finished = spin_until(node, lambda: bool(started) and ended - started > seconds, timeout_s)
    return (answers - WARM_UP) / (ended - started) if finished else 0.0


def _bare(topic: topics.Topic) -> topics.Topic:
    return replace(topic, name=f"bare/{topic.name.strip('/')}")


def _answerer() -> Any:
    from rclpy.node import Node

    class Answerer(Node):
        """Answers every step with the same command."""

        def __init__(self) -> None:
            super().__init__("pingpong")
            command = encode_command(sample_step()[1])
            writer = _bare(topics.JOINT_COMMANDS).publisher(self)
            _bare(topics.OBJECT_FEATURES).subscribe(self, lambda _: writer.publish(command))

        def close(self) -> None:
            """Nothing to save."""

    return Answerer()


if __name__ == "__main__":
    sys.exit(run_node("pingpong", _answerer))
