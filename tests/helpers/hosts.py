"""Several hosts made of network namespaces: a switch, and a cable to each host."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

BAD_LINK = Path(__file__).with_name("bad_link.py")
# What the wheels' programs need that are not Python's.
LIBRARIES = f"{sysconfig.get_path('platlib')}/ros_fastrtps.libs:{sys.prefix}/lib"
# What this process has set for itself, and a child on another host must not inherit.
OWN = ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH", "FASTRTPS_DEFAULT_PROFILES_FILE",
       "RMW_FASTRTPS_USE_QOS_FROM_XML")  # fmt: skip


def why_not() -> str:
    """Why this machine makes no network namespaces; empty: it does."""
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
    """Hosts 10.77.0.1, 10.77.0.2, … on one switch; what runs in one is stopped with it."""

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
        """Put a bad link (its options: `bad_link.py`) between a host's port and the switch."""
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
        """Pull a host's cable, or plug it in."""
        ip("-n", self._switch, "link", "set", f"port{host}", "up" if plugged else "down")

    def run(
        self,
        host: int,
        command: Sequence[object],
        environment: Mapping[str, str] | None = None,
        log: Path = Path(os.devnull),
    ) -> None:
        """Run a command on a host until all are stopped."""
        kept = {k: v for k, v in os.environ.items() if k not in OWN}
        kept["LD_LIBRARY_PATH"] = LIBRARIES if str(command[0]) != sys.executable else ""
        kept = {k: v for k, v in (kept | dict(environment or {})).items() if v}
        words = ["ip", "netns", "exec", self.names[host], *map(str, command)]
        with log.open("ab") as output:
            self._processes.append(subprocess.Popen(words, stdout=output, stderr=output, env=kept))

    def running(self, host: int) -> list[int]:
        """The processes of a host."""
        words = ["ip", "netns", "pids", self.names[host]]
        found = subprocess.run(words, check=True, capture_output=True, text=True)
        return [int(word) for word in found.stdout.split()]

    def switch_off(self, host: int) -> None:
        """End all that runs on a host, without warning."""
        for process in self.running(host):
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def stop(self) -> None:
        """End all that runs, in good order."""
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
        """End all that runs, and take the hosts away."""
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
