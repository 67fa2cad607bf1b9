"""Several hosts made of network namespaces, with a switch and a cable to each host."""

import os
import re
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from helpers.recordings import SMALL
from helpers.waiting import wait_for
from pa_ros.core.errors import PaError
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.folder import checkpoint_of

BAD_LINK = Path(__file__).with_name("bad_link.py")
# Libraries that the compiled programs of the ROS wheels need.
LIBRARIES = f"{sysconfig.get_path('platlib')}/ros_fastrtps.libs:{sys.prefix}/lib"
# Variables that this process set for itself and that a process on another host must not inherit.
OWN = ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH", "FASTRTPS_DEFAULT_PROFILES_FILE",
       "RMW_FASTRTPS_USE_QOS_FROM_XML")  # fmt: skip


def why_not() -> str:
    """The reason why this machine cannot make network namespaces; empty if it can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    name = f"pa-{os.getpid()}-try"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    if made.returncode:
        return f"network namespaces are not permitted here: {made.stderr.strip()}"
    ip("netns", "del", name)
    return ""


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


class Hosts:
    """Hosts 10.77.0.1, 10.77.0.2, … on one switch. Removing a host ends its processes."""

    def __init__(self, count: int) -> None:
        self._stem = f"pa-{os.getpid()}"
        self._switch = f"{self._stem}-switch"
        self.names = [f"{self._stem}-{i}" for i in range(1, count + 1)]
        self._processes: list[subprocess.Popen[bytes]] = []

    def address(self, host: int) -> str:
        return f"10.77.0.{host + 1}"

    def make(self) -> None:
        ip("netns", "add", self._switch)
        ip("-n", self._switch, "link", "add", "bridge", "type", "bridge")
        ip("-n", self._switch, "link", "set", "bridge", "up")
        for host, name in enumerate(self.names):
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "add", "eth0", "type", "veth", "peer", "name", f"port{host}",
               "netns", self._switch)  # fmt: skip
            ip("-n", name, "addr", "add", f"{self.address(host)}/24", "dev", "eth0")
            ip("-n", name, "link", "set", "eth0", "up")
            ip("-n", name, "route", "add", "224.0.0.0/4", "dev", "eth0")
            ip("-n", self._switch, "link", "set", f"port{host}", "master", "bridge", "up")

    def worsen(self, host: int, *options: str, log: Path = Path(os.devnull)) -> None:
        """Put a bad link between a host and the switch; for its options see `bad_link.py`."""
        inside = ["ip", "netns", "exec"]
        ip("-n", self._switch, "link", "set", f"port{host}", "nomaster", "promisc", "on")
        ip("-n", self._switch, "link", "add", f"up{host}", "type", "veth", "peer", "name",
           f"plug{host}")  # fmt: skip
        ip("-n", self._switch, "link", "set", f"up{host}", "promisc", "on", "up")
        ip("-n", self._switch, "link", "set", f"plug{host}", "master", "bridge", "up")
        for name in self.names:
            self._finish_frames([*inside, name], "eth0")
        words = [*inside, self._switch, sys.executable, str(BAD_LINK), f"port{host}", f"up{host}"]
        with log.open("ab") as output:
            self._processes.append(
                subprocess.Popen([*words, *options], stdout=output, stderr=output)
            )

    def _finish_frames(self, within: list[str], interface: str) -> None:
        code = f"import bad_link; bad_link.no_offload({interface!r})"
        subprocess.run([*within, sys.executable, "-c", code], check=True, cwd=BAD_LINK.parent)

    def cable(self, host: int, plugged: bool) -> None:
        """Plug or unplug the cable of a host."""
        ip("-n", self._switch, "link", "set", f"port{host}", "up" if plugged else "down")

    def run(
        self,
        host: int,
        command: Sequence[object],
        environment: Mapping[str, str] | None = None,
        log: Path = Path(os.devnull),
    ) -> None:
        """Start a command on a host; it runs until `stop`."""
        kept = {k: v for k, v in os.environ.items() if k not in OWN}
        kept["LD_LIBRARY_PATH"] = LIBRARIES if str(command[0]) != sys.executable else ""
        kept = {k: v for k, v in (kept | dict(environment or {})).items() if v}
        words = ["ip", "netns", "exec", self.names[host], *map(str, command)]
        with log.open("ab") as output:
            self._processes.append(subprocess.Popen(words, stdout=output, stderr=output, env=kept))

    def running(self, host: int) -> list[int]:
        """The process ids of a host."""
        words = ["ip", "netns", "pids", self.names[host]]
        found = subprocess.run(words, check=True, capture_output=True, text=True)
        return [int(word) for word in found.stdout.split()]

    def switch_off(self, host: int) -> None:
        """Kill every process of a host, without warning."""
        for process in self.running(host):
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def stop(self) -> None:
        """Terminate all processes and wait for them."""
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(5)
        self._processes.clear()

    def remove(self) -> None:
        """Terminate all processes and remove the hosts."""
        self.stop()
        for name in (*self.names, self._switch):
            ip("netns", "del", name)


@contextmanager
def hosts(count: int) -> Iterator[Hosts]:
    made = Hosts(count)
    made.make()
    try:
        yield made
    finally:
        made.remove()


NO_HOSTS = why_not()
SUBNET = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


class Site:
    """A learner on one host and an arena with its agent on each of two others."""

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

    def begin(self, *, sim: Mapping[str, Any] | None = None, **learner: Any) -> None:
        arenas = ["arena1", "arena2"]
        learner = SMALL | learner | {"out": str(self.folder / "run")}
        learner.setdefault("checkpoint_every_frames", 200)
        self.run(0, "learner_node", arenas=arenas, **learner)
        for host, arena in enumerate(arenas, start=1):
            self.run(host, "sim_node", f"/{arena}", seed=host, **(sim or {}))
            agent = {"learning": True, "learner": "/", "agent_id": arena, "stuck_after_s": 3.0}
            self.run(host, "agent_node", f"/{arena}", **agent)

    def record(self, bag: Path, topics: Sequence[str], host: int = 0) -> None:
        """Start to record some topics on a host, before the other nodes start."""
        words = [sys.executable, "-m", "pa_ros", "record", bag, "--arenas", "arena1", "arena2"]
        environment = self._common | self._environment(host)
        log = self.folder / f"record-{host}.log"
        self.hosts.run(host, [*words, "--topics", *topics], environment, log)
        wait_for(lambda: "recording" in (log.read_text() if log.exists() else ""), "a recorder")

    @property
    def ledger(self) -> dict[str, Any]:
        """The sequence numbers of all agents in the newest checkpoint."""
        return dict(self._metadata()["replay"]["ledger"])

    @property
    def accounts(self) -> dict[str, dict[str, Any]]:
        """What that checkpoint says of each agent."""
        return {one["agent_id"]: one for one in self.ledger["agents"]}

    @property
    def frames(self) -> int:
        log = self.folder / "0-learner_node.log"
        told = re.findall(r"frames ([\d,]+) \(", log.read_text()) if log.exists() else []
        return int(told[-1].replace(",", "")) if told else 0

    @property
    def heard(self) -> set[str]:
        """The agents of which the newest checkpoint contains trajectories."""
        try:
            return set(self.accounts)
        except PaError:  # no checkpoint yet
            return set()

    def learns(self, frames: int = 500) -> None:
        """Wait until both agents act and the learner has learned from `frames` more frames."""
        for host in (1, 2):
            log = self.folder / f"{host}-agent_node.log"
            wait_for(lambda log=log: "]: acting" in log.read_text(), f"acting in {log}")  # type: ignore[misc]
        wait_for(lambda: self.heard == {"arena1", "arena2"}, "both agents' trajectories")
        before = self._saved_frames()
        wait_for(lambda: self._saved_frames() >= before + frames, f"{frames} frames after {before}")

    def _saved_frames(self) -> int:
        """Frames in the newest checkpoint; the log states them only now and then."""
        return int(self._metadata()["counters"]["frames"])

    def _metadata(self) -> dict[str, Any]:
        """Of the newest checkpoint, read rarely, because the nodes need the processor."""
        time.sleep(0.25)
        try:
            return read_metadata(checkpoint_of(self.folder / "run"))
        except PaError:  # none yet, or it was replaced meanwhile
            return read_metadata(checkpoint_of(self.folder / "run"))


def ended(site: Site) -> dict[str, dict[str, object]]:
    """Stop everything; what the learner's last checkpoint says of each agent."""
    site.hosts.stop()
    return site.accounts
