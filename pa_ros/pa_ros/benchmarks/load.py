"""How many agents one learner takes: `pa_ros bench load`."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rclpy.node import Node

from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.references import random_policy
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey
from pa_ros.core.report import Report
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.topics import LEARNER_INFO, POLICY_WEIGHTS, TRAJECTORIES
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.wire import Message
from pa_ros.wire.learning import decode_learner_info, decode_weights, encode_trajectory
from pa_ros.world import Trajectory

DESIGN, PRESET = "2-L", "fast"
RECORDED = 20  # episodes of a random policy, which the simulated agents send in turn
TIMEOUT_S = 120.0
TICK_S = 0.01


class LoadError(PaError):
    """A learner that did not take what it was sent in time."""

    code = "bench.load"


class Crowd:
    """Simulated agents: each sends a recorded trajectory once an episode's time has passed, at
    so many times real time, whatever the learner does."""

    def __init__(self, node: Node, agents: int, trajectories: Sequence[Trajectory], each_s: float):
        self.sent = 0
        self.weights_bytes: list[int] = []
        self._recorded, self._each_s = trajectories, each_s
        self._keys = [AgentKey(f"simulated-{i:03}", 1) for i in range(agents)]
        self._next = [0] * agents
        self._run_id = ""
        self.began_at: float | None = None
        self._publisher = TRAJECTORIES.publisher(node)
        LEARNER_INFO.subscribe(node, self._on_learner)
        POLICY_WEIGHTS.subscribe(node, self._on_weights)
        self.stopped = False
        steady_timer(node, TICK_S, self._tick)

    def _on_learner(self, message: Message) -> None:
        self._run_id = decode_learner_info(message).run_id
        self.began_at = self.began_at or time.monotonic()

    def _on_weights(self, message: Message) -> None:
        tensors = decode_weights(message).snapshot.tensors
        self.weights_bytes.append(sum(tensor.nbytes for tensor in tensors.values()))

    def _tick(self) -> None:
        """Send what is due: agent i's m-th trajectory (m + i/n) periods after the beginning."""
        if self.began_at is None or self.stopped:
            return
        periods = (time.monotonic() - self.began_at) / self._each_s
        for i, key in enumerate(self._keys):
            while self._next[i] + i / len(self._keys) < periods:
                self._send(i, key)

    def _send(self, agent: int, key: AgentKey) -> None:
        sequence = self._next[agent]
        self._next[agent] += 1
        self.sent += 1
        trajectory = self._recorded[self.sent % len(self._recorded)]
        self._publisher.publish(
            encode_trajectory(
                replace(
                    trajectory,
                    agent_id=key.agent_id,
                    incarnation=key.incarnation,
                    sequence=sequence,
                    run_id=self._run_id,
                )
            )
        )


def bench_load(agents: int = 100, seconds: float = 30.0, updates_per_frame: float = 0.25) -> Report:
    """`agents` simulated agents in real time (an episode of 10 s each) send to one learner.

    `load.lost`: trajectories sent that the learner has neither learned from, refused nor has in
    hand in the end. `load.backlog`: what waited when the sending ended; it grows where the learner
    is slower than its agents. `load.weights_mb_per_s`: of weights for one reader.
    """
    use_domain(None)
    trajectories = recorded()
    each_s = len(trajectories[0]) * preset_named(PRESET).control_period_s
    figures = GraphFigures()
    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("bench") as node:
            watch_diagnostics(node, figures)
            crowd = Crowd(node, agents, trajectories, each_s)
            processes = start_nodes(supervisor, _parameters(updates_per_frame), Path(name))
            process = processes["learner_node"]
            rates, memory = _sample(node, supervisor, figures, crowd, seconds, process)
            backlog = figures.value("learner_node", "backlog") or 0.0
            return {
                "load.agents": agents,
                "load.sent": crowd.sent,
                "load.lost": _lost(node, supervisor, figures, crowd),
                "load.frames_per_s": crowd.sent * len(trajectories[0]) / seconds,
                "load.updates_per_s": statistics.median(rates),
                "load.updates_per_frame": updates_per_frame,
                "load.backlog": backlog,
                "load.memory_mb_first": memory[0],
                "load.memory_mb_last": memory[-1],
                "load.weights_kb": statistics.median(crowd.weights_bytes) / 1e3,
                "load.weights_mb_per_s": sum(crowd.weights_bytes) / 1e6 / seconds,
            }


def recorded(episodes: int = RECORDED) -> list[Trajectory]:
    """Episodes of a random policy, each a trajectory."""
    design, arena = design_named(DESIGN), preset_named(PRESET)
    task, limits = ReachTask(arena, design, seed=0), np.array(arena.joint_speed_limits)
    policy, found = random_policy(0), []
    key, steps = AgentKey("recorded", 1), arena.episode_steps
    builder = TrajectoryBuilder(key, "", steps, task.world)
    for index in range(episodes):
        observation, verdict = task.reset(index)
        while (trajectory := builder.observe(observation, verdict, task.program)) is None:
            velocity = policy(task)
            builder.acted((velocity / limits).astype(np.float32), 0)
            observation, verdict = task.step(velocity)
        found.append(trajectory)
    return found


def _parameters(updates_per_frame: float) -> Parameters:
    """An arena that only announces itself, and a learner that soon learns."""
    options = [
        f"learner.updates.per_frame={updates_per_frame}",
        "learner.replay.warmup_frames=1000",
    ]
    return {
        "sim_node": {"design": DESIGN, "preset": PRESET, "paused": True},
        "learner_node": {"options": options},
    }


def _sample(
    node: Node,
    supervisor: Supervisor,
    figures: GraphFigures,
    crowd: Crowd,
    seconds: float,
    process: int,
) -> tuple[list[float], list[float]]:
    """Updates per second and memory (MB), each time the learner spoke while it was loaded."""
    rates: list[float] = []
    memory: list[float] = []

    def sample() -> None:
        if figures.value("learner_node", "updates"):
            rates.append(figures.value("learner_node", "updates_per_s") or 0.0)
            memory.append(resident_mb(process))

    def enough() -> bool:
        due = crowd.began_at is not None and time.monotonic() - crowd.began_at > seconds
        return due and bool(rates)

    if not watch(node, supervisor, sample, enough, TIMEOUT_S + seconds):
        raise LoadError(f"load: expected updates within {TIMEOUT_S:g} s, got none")
    crowd.stopped = True
    return rates, memory


def _lost(node: Node, supervisor: Supervisor, figures: GraphFigures, crowd: Crowd) -> int:
    """Trajectories that were sent, and neither learned from nor refused once nothing waits."""

    def unaccounted() -> int:
        names = ("version", "rejected_trajectories", "duplicates")
        return crowd.sent - int(sum(figures.value("learner_node", name) or 0 for name in names))

    watch(node, supervisor, lambda: None, lambda: unaccounted() <= 0, TIMEOUT_S)
    return unaccounted()


def resident_mb(process: int) -> float:
    """Memory of a process that is in RAM, MB."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
