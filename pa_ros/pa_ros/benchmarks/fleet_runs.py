"""One run of a fleet that is watched from outside: how fast, and with which weights when."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pa_ros.core.errors import PaError
from pa_ros.core.experience import PolicySnapshot
from pa_ros.ros.topics import POLICY_WEIGHTS
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_domain
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters, fleet, in_step
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.wire import Message
from pa_ros.wire.learning import decode_weights

UNTHROTTLED_S = 15.0
TIMEOUT_S = 1800.0


class FleetError(PaError):
    """A fleet that did not learn in time."""

    code = "bench.fleet"


@dataclass(frozen=True)
class Request:
    """Which fleet, and how long: so many frames, or so many seconds after the first update."""

    arenas: int
    sim: Mapping[str, Any]
    seed: int
    options: Sequence[str]
    in_step: str
    frames: int = 0
    seconds: float = 0.0

    def parameters(self) -> Parameters:
        """Of all nodes."""
        one: Parameters = {
            "sim_node": dict(self.sim),
            "agent_node": {"learning": True, "seed": 100 * self.seed},
            "learner_node": {"seed": self.seed, "options": list(self.options)},
        }
        return in_step(fleet(one, self.arenas), self.in_step)


@dataclass
class Heard:
    """What was heard of a run."""

    frames_per_s: float = 0.0
    updates_per_s: float = 0.0
    too_old: int = 0
    interrupted: int = 0
    versions: list[tuple[float, float, PolicySnapshot]] = field(default_factory=list)
    """Seconds since the learner's first weights, frames, weights."""


def heard(request: Request, every: int) -> Heard:
    """Run it; weights are kept of every so many versions. Raises FleetError."""
    use_domain(None)
    figures, policies = GraphFigures(), dict[int, tuple[int, PolicySnapshot]]()
    marks: list[tuple[float, float, float]] = []  # s, frames, updates

    def keep(message: Message) -> None:
        policy = decode_weights(message)
        version = policy.snapshot.version
        if not policies or version >= max(policies) + every:
            policies.setdefault(version, (policy.stamp_ns, policy.snapshot))

    def value(name: str) -> float:
        return figures.value("learner_node", name) or 0.0

    def sample() -> None:
        at = (value("frames"), value("updates"))
        if at[1] and (not marks or at != marks[-1][1:]):
            marks.append((time.monotonic(), *at))

    def enough() -> bool:
        if request.frames:
            return value("frames") >= request.frames
        return bool(marks) and marks[-1][0] - marks[0][0] >= request.seconds

    with tempfile.TemporaryDirectory() as name, Supervisor(Path(name)) as supervisor:
        with client_node("bench") as node:
            watch_diagnostics(node, figures)
            POLICY_WEIGHTS.subscribe(node, keep)
            start_nodes(supervisor, request.parameters(), Path(name))
            if not watch(node, supervisor, sample, enough, TIMEOUT_S) or len(marks) < 2:
                raise FleetError(f"fleet: expected {request} within {TIMEOUT_S:g} s, got {marks}")
            found = Heard(
                too_old=int(value("too_old_trajectories")),
                interrupted=int(figures.value("agent_node", "interrupted", sum) or 0),
            )
            each = value("frames") / max(value("version"), 1.0)  # frames of a trajectory
    (began, frames, updates), (ended, most, last) = marks[0], marks[-1]
    found.frames_per_s = (most - frames) / (ended - began)
    found.updates_per_s = (last - updates) / (ended - began)
    first_ns = policies[min(policies)][0]
    for version, (stamp_ns, snapshot) in sorted(policies.items()):
        found.versions.append(((stamp_ns - first_ns) / 1e9, version * each, snapshot))
    return found
