"""Seeds and scores as tasks of a Ray cluster of two hosts, one of which is switched off midway."""

from __future__ import annotations

import shutil
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from helpers.hosts import Hosts, hosts, why_not
from helpers.seeds_on_cluster import CONDITIONS, EPISODES, SEEDS, SMALL
from helpers.waiting import wait_for
from pa_ros.cli.main import main
from pa_ros.core.errors import PaError
from pa_ros.evaluation.scoring.agents import load_agent
from pa_ros.evaluation.studies import cluster
from pa_ros.evaluation.studies.cluster import ClusterError, write_files
from pa_ros.evaluation.studies.cluster_jobs import SeedJob
from pa_ros.evaluation.studies.curves import CURVE, frames_done, read_curve
from pa_ros.evaluation.studies.experiments import run_seed
from pa_ros.evaluation.studies.failures import FailedError
from pa_ros.evaluation.studies.generalization import generalize
from pa_ros.evaluation.studies.seeds import folder_of, train_seeds
from pa_ros.learning.checkpoint_files import LATEST
from pa_ros.learning.folder import checkpoint_of, claim

DRIVER = Path(__file__).parents[1] / "helpers" / "seeds_on_cluster.py"
RAY = Path(sys.executable).with_name("ray")
PORT = 6379
ENVIRONMENT = {
    # A node is given up after 1.5 s without an answer.
    "RAY_health_check_initial_delay_ms": "0",
    "RAY_health_check_period_ms": "500",
    "RAY_health_check_timeout_ms": "1000",
    "RAY_health_check_failure_threshold": "3",
    "RAY_worker_niceness": "0",  # 15, else: a busy machine would hardly let them run
}
NODE = ["--num-cpus=1", "--object-store-memory=100000000", "--include-log-monitor=false",
        "--disable-usage-stats", "--block"]  # fmt: skip
WHY_NOT = why_not() or ("" if RAY.exists() else "Ray is not installed (the extra cluster)")


@pytest.fixture
def two() -> Iterator[Hosts]:
    """Two hosts with a Ray node each, the first one's the head."""
    place = tempfile.mkdtemp(prefix="ray", dir="/tmp")  # its sockets' names are long
    with hosts(2) as made:
        head = [f"--port={PORT}", "--include-dashboard=false", f"--temp-dir={place}"]
        address = f"{made.address(0)}:{PORT}"
        for host, words in enumerate(([*head, "--head"], [f"--address={address}"])):
            node = f"--node-ip-address={made.address(host)}"
            command = [RAY, "start", node, *words, *NODE]
            log = Path(place) / f"{host}.log"
            made.run(host, command, ENVIRONMENT, log)
            wait_for(lambda: "Ray runtime started" in log.read_text(), "a node")  # noqa: B023
        yield made
        made.stop()
        for host in range(2):
            wait_for(lambda: not made.running(host), f"host {host} without processes")  # noqa: B023
    shutil.rmtree(place, ignore_errors=True)


def at_work(two: Hosts, host: int) -> bool:
    """Whether a host does a part now: Ray's workers are called as what they do."""
    called = (Path(f"/proc/{process}/cmdline") for process in two.running(host))
    return any(path.exists() and b"ray::do_part" in path.read_bytes() for path in called)


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "-")
def test_a_lost_node_costs_a_part_and_no_bit(two: Hosts, tmp_path: Path):
    log, runs = tmp_path / "log", tmp_path / "runs"
    begun = [checkpoint_of(folder_of(runs, seed)) / LATEST for seed in SEEDS]
    ended = tmp_path / "ended"
    two.run(0, [sys.executable, DRIVER, f"{two.address(0)}:{PORT}", tmp_path, ended], log=log)
    wait_for(
        lambda: all(map(Path.exists, begun)) and at_work(two, 1) or ended.exists(),
        "a part of each seed, and one on the other host",
    )
    assert not ended.exists(), log.read_text()
    two.switch_off(1)
    wait_for(ended.exists, "the driver's end")
    said = log.read_text()
    assert ended.read_text() == "0", said
    assert "its node is gone" in said and "goes on from what was fetched last" in said
    for seed in SEEDS:
        here = tmp_path / "here" / f"{seed}"
        run_seed(SMALL, seed, here)
        there = folder_of(runs, seed)
        assert load_agent(there).digest == load_agent(here).digest
        frames = [row["frames"] for row in read_curve(there / CURVE)]
        assert frames == [row["frames"] for row in read_curve(here / CURVE)]
        assert len(list(checkpoint_of(there).glob("version-*"))) == 2
    agents = {seed: load_agent(folder_of(runs, seed)) for seed in SEEDS}
    cached, fresh = [
        generalize(agents, tmp_path / cache, EPISODES, CONDITIONS, lambda line: None)
        for cache in ("scores", "fresh")
    ]
    assert cached == fresh


def refused(capsys: pytest.CaptureFixture[str], address: str, name: str = "programmable-2L") -> str:
    assert main(["experiment", name, "--cluster", address, "--seeds", "1"]) == 2
    line, *others = capsys.readouterr().err.splitlines()
    assert not others
    return line


def test_a_cluster_that_cannot_be_used_is_one_line(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert "no --cluster, --seeds: it reads tables" in refused(capsys, "x:1", "variants")
    monkeypatch.setattr(cluster, "_ray", lambda: None)
    assert "expected HOST:PORT of Ray's head, got 'ray://x'" in refused(capsys, "ray://x")
    assert "expected HOST:PORT of Ray's head" in refused(capsys, f"x:{'9' * 5000}")
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        free = "{}:{}".format(*nobody.getsockname())
    assert f"head to answer at {free}, got: [Errno 111]" in refused(capsys, free)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        taken = "{}:{}".format(*server.getsockname())
        assert f"Ray's head at {taken}, got another server" in refused(capsys, taken)
        thread.join()


class LocalRay:
    """Ray as far as `Cluster.run` needs it, at once and in this process; node 0 dies once."""

    class exceptions:
        class RayError(Exception):
            pass

        class RayTaskError(RayError):
            cause: Exception

    def __init__(self) -> None:
        self.died = False

    def remote(self, **_: Any) -> Any:
        return lambda work: SimpleNamespace(remote=lambda *given: partial(work, *given))

    def wait(self, running: list[Any], timeout: float) -> tuple[list[Any], list[Any]]:
        return running[:1], running[1:]

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 2.0}

    def get(self, task: Any) -> Any:
        if not self.died:
            self.died = True
            raise self.exceptions.RayError
        try:
            return task()
        except PaError as error:
            failed = self.exceptions.RayTaskError()
            failed.cause = error
            raise failed from error


def test_a_seed_that_is_refused_leaves_the_others_to_be_trained(tmp_path, capsys) -> None:
    """Here and on a cluster: the same again would end at the same seed for ever."""
    said: list[str] = []
    there = object.__new__(cluster.Cluster)
    there._ray, there._extended = LocalRay(), ()
    wrong = replace(SMALL, options={"learner.updates.discount": float("nan")})
    jobs = [SeedJob(wrong if seed == 1 else SMALL, seed, tmp_path / f"seed-{seed}")
            for seed in range(3)]  # fmt: skip
    with pytest.raises(FailedError, match=r"but for seed 1: .*discount.*got 'nan'"):
        there.run(jobs, lambda: None, said.append)
    assert [line.partition(":")[0] for line in said] == ["seed 0", "seed 1 ended early"]
    for seed in (0, 2):
        assert frames_done(tmp_path / f"seed-{seed}" / CURVE) == SMALL.frames
    short = replace(SMALL, frames=500)
    with (
        claim(folder_of(tmp_path / "here", 0)),
        pytest.raises(FailedError, match="but for seed 0: .*another run writes into"),
    ):
        train_seeds(short, (0, 1), tmp_path / "here", jobs=1)
    assert frames_done(folder_of(tmp_path / "here", 1) / CURVE) == 500
    said = capsys.readouterr().out  # no terminal: no bar is seen before the end
    assert "seed 0 ended early" in said and "seed 1 is trained" in said


def test_without_ray_its_extra_is_named(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "ray", None)
    assert 'pip install "programmable-agents[cluster]"' in refused(capsys, "127.0.0.1:1")


def test_a_node_of_other_software_and_files_elsewhere_are_refused(tmp_path):
    with pytest.raises(ClusterError, match="expected on every node python 2"):
        cluster.do_part(cluster.Part(print, lambda _: {}, {}), "python 2", ())
    with pytest.raises(ClusterError, match=r"below .*, got '\.\./x'"):
        write_files(tmp_path / "in", {"../x": b""})
    assert not (tmp_path / "x").exists()
