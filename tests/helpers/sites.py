"""Three hosts, a learner on one, an arena with its agent on each of the others; what tests of
machines share."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from helpers.hosts import Hosts, why_not
from helpers.recorded_runs import SMALL
from helpers.waiting import wait_for
from pa_ros.core.errors import PaError
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.folder import checkpoint_of

NO_HOSTS = why_not()
SUBNET = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


class Site:
    """The three hosts' processes, and how far the learner is by its own log."""

    def __init__(self, made: Hosts, folder: Path, environment: Callable[[int], dict[str, str]]):
        self.hosts, self.folder = made, folder
        self._environment = environment
        common = {"ROS_DOMAIN_ID": "3", "ROS_LOG_DIR": str(folder)}
        self._common = common | {"OMP_NUM_THREADS": "1"}

    def run(self, host: int, node: str, namespace: str = "", **parameters: object) -> None:
        path = self.folder / f"{host}-{node}.yaml"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
        log = self.folder / f"{host}-{node}.log"
        words = [sys.executable, "-m", f"{node}.main", "--ros-args", "--params-file", path]
        words += ["-r", f"__ns:={namespace}"] if namespace else []
        environment = self._common | self._environment(host)
        self.hosts.run(host, words, environment, log)

    def begin(self, *options: str, sim: Mapping[str, Any] | None = None, **learner: Any) -> None:
        arenas = ["arena1", "arena2"]
        learner |= {"options": [*SMALL, *options], "out": str(self.folder / "run")}
        learner.setdefault("checkpoint_every_frames", 200)
        self.run(0, "learner_node", arenas=arenas, **learner)
        for host, arena in enumerate(arenas, start=1):
            self.run(host, "sim_node", f"/{arena}", seed=host, **(sim or {}))
            agent = {"learning": True, "learner": "/", "agent_id": arena, "stuck_after_s": 3.0}
            self.run(host, "agent_node", f"/{arena}", **agent)

    def record(self, bag: Path, topics: Sequence[str], host: int = 0) -> None:
        """Some topics, on the learner's host or an arena's, from before all begins."""
        words = [sys.executable, "-m", "pa_ros", "record", bag, "--arenas", "arena1", "arena2"]
        environment = self._common | self._environment(host)
        log = self.folder / f"record-{host}.log"
        self.hosts.run(host, [*words, "--topics", *topics], environment, log)
        wait_for(lambda: "recording" in (log.read_text() if log.exists() else ""), "a recorder")

    @property
    def ledger(self) -> dict[str, Any]:
        """As the newest checkpoint has it."""
        return dict(read_metadata(checkpoint_of(self.folder / "run"))["replay"]["ledger"])

    @property
    def frames(self) -> int:
        log = self.folder / "0-learner_node.log"
        told = re.findall(r"frames ([\d,]+) \(", log.read_text()) if log.exists() else []
        return int(told[-1].replace(",", "")) if told else 0

    @property
    def heard(self) -> set[str]:
        """The agents that the newest checkpoint accounts for."""
        try:
            return set(self.ledger["accounts"])
        except PaError:  # there is none yet
            return set()

    def learns(self, frames: int = 500) -> None:
        """Wait until it has learned from so many more, once both agents act and were heard."""
        for host in (1, 2):
            log = self.folder / f"{host}-agent_node.log"
            wait_for(lambda log=log: "]: acting" in log.read_text(), f"acting in {log}")  # type: ignore[misc]
        wait_for(lambda: self.heard == {"arena1", "arena2"}, "both agents' trajectories")
        before = self.frames
        wait_for(lambda: self.frames >= before + frames, f"{frames} frames after {before}")


def ended(site: Site) -> dict[str, dict[str, object]]:
    """The learner's account of each agent, once it has saved and all have ended."""
    site.hosts.stop()
    return dict(site.ledger["accounts"])
