"""Jobs as tasks of a Ray cluster (the extra `cluster`).

A job works in a folder, part by part. The driver holds what every part begins from, so a node that
is lost costs the part that it was at, and no more. Files travel as bytes; nodes keep nothing.
"""

from __future__ import annotations

import importlib
import os
import socket
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from pa_ros.core import extensions
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.software import versions
from pa_ros.core.text import natural
from pa_ros.evaluation.studies.failures import check_failures

Files = Mapping[str, bytes]
"""Contents by the path within a folder."""

REFRESH_S = 1.0
ANSWER_S = 5.0  # that a head may take to be reached
LOSSES = 5  # of one part in a row, after which it is not tried again
HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\4\0\0\0\0\0"  # RFC 9113, 3.4: gRPC answers
SETTINGS_FRAME = 4


class ClusterError(ConfigError):
    """A cluster that cannot be used, or that no longer works."""

    code = "config.cluster"


@dataclass(frozen=True)
class Part:
    """What a node does: `work` in a folder that holds `files`; `keep` picks what comes back."""

    work: Callable[[Path], None]  # and `keep`: of modules, so that nodes can import them
    keep: Callable[[Path], Files]
    files: Files


class Job(Protocol):
    """Something to be done in parts, one after another."""

    @property
    def name(self) -> str:
        """What it is called in messages."""

    def part(self) -> Part | None:
        """The next part, from what has been taken so far; None: all is done."""

    def take(self, files: Files) -> None:
        """Keep what came of the part."""


def read_files(root: Path, paths: Iterable[Path]) -> Files:
    """The contents of files below `root`."""
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in paths}


def write_files(root: Path, files: Files) -> None:
    """Write what a node sent, in order, each file whole or not at all; only below `root`."""
    for name, content in files.items():
        path = root / name
        if not path.resolve().is_relative_to(root.resolve()):
            raise ClusterError(f"cluster: expected files below {root}, got {name!r}")
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_name(f".{path.name}.unfinished")
        unfinished.write_bytes(content)
        os.replace(unfinished, path)


def do_part(part: Part, software: str, extended: Sequence[str]) -> dict[str, bytes]:
    """On a node: the part's work in a folder of its own. ClusterError unless it has `software`."""
    if versions() != software:
        raise ClusterError(
            f"cluster: expected on every node {software}; got on {socket.gethostname()} "
            f"{versions()}"
        )
    extensions.load(extended)
    with tempfile.TemporaryDirectory(prefix="pa-ros-part-") as name:
        folder = Path(name)
        write_files(folder, part.files)
        part.work(folder)
        return dict(part.keep(folder))


class Cluster:
    """The Ray cluster whose head listens at `address`; a context. This machine is one of its nodes.

    ClusterError unless Ray is installed and a head answers there.
    """

    def __init__(self, address: str, extended: Sequence[str] = ()) -> None:
        """`extended`: extensions that nodes import."""
        self._extended = extended
        self._ray = _ray()
        _check_answers(address)
        try:
            self._ray.init(address, log_to_driver=False, logging_level="ERROR", namespace="pa_ros")
        except (ConnectionError, RuntimeError, ValueError, AssertionError) as error:
            self._ray.shutdown()
            reason = " ".join(str(error).split())
            raise ClusterError(f"cluster {address}: expected Ray's head, got: {reason}") from error

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        self._ray.shutdown()  # and with it what this driver still had to be done

    def run(
        self, jobs: Iterable[Job], progress: Callable[[], None], tell: Callable[[str], None]
    ) -> None:
        """Do all jobs, as many at a time as the nodes have processors.

        `progress` is called about once a second, `tell` says which part was lost with its node and
        is done again, and which job was refused or diverged, after which the others go on:
        FailedError, once they are through. ClusterError if a node cannot be used, or one part is
        lost LOSSES times.
        """
        task = self._ray.remote(num_cpus=1, max_retries=0)(do_part)
        software, lost = versions(), dict[str, int]()
        failures: dict[str, PaError] = {}
        running: dict[Any, Job] = {}
        waiting = deque(jobs)
        while waiting or running:
            while waiting and len(running) < max(1, self._processors()):
                job = waiting.popleft()
                if (part := job.part()) is not None:
                    running[task.remote(part, software, self._extended)] = job
            ended, _ = self._ray.wait(list(running), timeout=REFRESH_S) if running else ([], [])
            for reference in ended:
                job = running.pop(reference)
                try:
                    why = self._take(reference, job)
                except ClusterError:
                    raise
                except PaError as error:
                    failures[job.name] = error
                    tell(f"{job.name} ended early: {error}")
                    continue
                if why is None:
                    lost.pop(job.name, None)
                else:
                    lost[job.name] = _lost_again(job.name, lost.get(job.name, 0), why, tell)
                waiting.appendleft(job)
            progress()
        check_failures(failures)

    def _take(self, reference: Any, job: Job) -> str | None:
        """Keep what came of a part; or why nothing came."""
        errors = self._ray.exceptions
        try:
            files = self._ray.get(reference)
        except errors.RayTaskError as error:
            if isinstance(error.cause, PaError):
                raise error.cause from None
            raise ClusterError(f"cluster: {job.name}: {error}") from error
        except errors.RayError as error:
            return type(error).__name__
        job.take(files)
        return None

    def _processors(self) -> int:
        return int(self._ray.cluster_resources().get("CPU", 0))


def _lost_again(name: str, before: int, why: str, tell: Callable[[str], None]) -> int:
    times = before + 1
    if times >= LOSSES:
        raise ClusterError(
            f"cluster: {name}: expected a node that lives, lost the same part {times} times ({why})"
        )
    tell(f"{name}: its node is gone ({why}); it goes on from what was fetched last")
    return times


def _ray() -> Any:
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # nothing is told to anybody
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise ClusterError(
            'cluster: expected the extra cluster (pip install "programmable-agents[cluster]"), '
            f"got: {error}"
        ) from error


def _check_answers(address: str) -> None:
    """Ray itself would try for minutes."""
    host, _, given = address.rpartition(":")
    port = natural(given) or 0
    if not host or not 0 < port < 1 << 16:
        raise ClusterError(f"cluster: expected HOST:PORT of Ray's head, got {address!r}")
    try:
        with socket.create_connection((host, port), ANSWER_S) as connection:
            connection.settimeout(ANSWER_S)
            connection.sendall(HELLO)
            answer = connection.recv(9)
    except OSError as error:
        raise ClusterError(
            f"cluster: expected Ray's head to answer at {address}, got: {error} "
            "(docs/scale.md says how to start one)"
        ) from error
    if answer[3:4] != bytes([SETTINGS_FRAME]):
        raise ClusterError(f"cluster: expected Ray's head at {address}, got another server")
