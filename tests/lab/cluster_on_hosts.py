"""Seeds on a Ray cluster of two hosts, one of which is switched off: `make links`."""

import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.hosts import Hosts, hosts, why_not
from helpers.seeds_on_cluster import SEEDS, SMALL
from helpers.waiting import wait_for
from laboratory.studies.experiments import run_seed
from laboratory.studies.seeds import folder_of
from laboratory.studies.tables import CURVE, read_curve
from pa_ros.agents import load_agent
from pa_ros.learning.checkpoint_files import LATEST
from pa_ros.learning.folder import checkpoint_of

DRIVER = Path(__file__).parents[1] / "helpers" / "seeds_on_cluster.py"
RAY = Path(sys.executable).with_name("ray")
PORT = 6379
ENVIRONMENT = {
    # A node is given up after 1.5 s without an answer.
    "RAY_health_check_initial_delay_ms": "0",
    "RAY_health_check_period_ms": "500",
    "RAY_health_check_timeout_ms": "1000",
    "RAY_health_check_failure_threshold": "3",
    "RAY_worker_niceness": "0",  # with the default, 15, a busy machine would hardly run them
    "PYTHONPATH": str(Path(__file__).parents[1]),
}
NODE = ["--num-cpus=1", "--object-store-memory=100000000", "--include-log-monitor=false",
        "--disable-usage-stats", "--block"]  # fmt: skip
WHY_NOT = why_not() or ("" if RAY.exists() else "Ray is not installed (the extra cluster)")


@pytest.fixture
def two() -> Iterator[Hosts]:
    """Two hosts with a Ray node each; the first one has the head."""
    place = tempfile.mkdtemp(prefix="ray", dir="/tmp")  # paths of Ray's sockets must be short
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
    """Whether a host works on a part: Ray's workers are named after their task."""
    called = (Path(f"/proc/{process}/cmdline") for process in two.running(host))
    return any(path.exists() and b"ray::do_part" in path.read_bytes() for path in called)


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "-")
def test_a_lost_node_costs_a_part_and_changes_no_bit(two: Hosts, tmp_path: Path):
    log, runs = tmp_path / "log", tmp_path / "runs"
    started = [checkpoint_of(folder_of(runs, seed)) / LATEST for seed in SEEDS]
    ended = tmp_path / "ended"
    command = [sys.executable, DRIVER, f"{two.address(0)}:{PORT}", tmp_path, ended]
    two.run(0, command, ENVIRONMENT, log)
    wait_for(
        lambda: all(map(Path.exists, started)) and at_work(two, 1) or ended.exists(),
        "a part of each seed, and one on the other host",
    )
    assert not ended.exists(), log.read_text()
    two.switch_off(1)
    wait_for(ended.exists, "the driver's end")
    output = log.read_text()
    assert ended.read_text() == "0", output
    assert "its node was lost" in output
    for seed in SEEDS:
        here = tmp_path / "here" / f"{seed}"
        run_seed(SMALL, seed, here)
        there = folder_of(runs, seed)
        assert load_agent(there).digest == load_agent(here).digest
        frames = [row["frames"] for row in read_curve(there / CURVE)]
        assert frames == [row["frames"] for row in read_curve(here / CURVE)]
        assert len(list(checkpoint_of(there).glob("version-*"))) == 2
