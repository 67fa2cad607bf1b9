"""Ctrl-C and a closed terminal end what runs in order."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S, wait_for
from pa_ros.cli.main import main
from pa_ros.tools.domain import DomainClaim


def sent(group: int, number: int) -> bool:
    """Whether anybody is left of a process group to get a signal."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    return True


@contextmanager
def command(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """`pa_ros` as a process with a group of its own, of which nothing is left."""
    heard = ("env", "--default-signal=INT,HUP")  # which pytest-xdist and nohup have ignored
    line = [*heard, sys.executable, "-m", "pa_ros", *map(str, arguments)]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        line, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        try:
            yield process
            wait_for(lambda: not sent(process.pid, 0), "the end of all processes")
        finally:
            sent(process.pid, signal.SIGKILL)


def test_ctrl_c_ends_an_experiment_with_the_seeds_that_were_to_follow(tmp_path):
    with command("experiment", "programmable-2L", "--seeds", "9", "--runs", tmp_path) as process:
        wait_for(lambda: list(tmp_path.rglob("progress.csv")), "a seed that learns")
        sent(process.pid, signal.SIGINT)
        _, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130, error
    assert len(list(tmp_path.rglob("progress.csv"))) == 1


INTERRUPTED_AT_ITS_START = """
import multiprocessing, os, signal
if multiprocessing.parent_process() is not None:
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_ctrl_c_is_for_the_experiment_not_for_a_seed_that_starts(tmp_path, monkeypatch):
    """A seed would say how far its imports were; the experiment ends it."""
    monkeypatch.chdir(tmp_path)
    Path("early.py").write_text(INTERRUPTED_AT_ITS_START)
    with command("--extension", "early.py", "experiment", "programmable-2L") as process:
        wait_for(lambda: list(tmp_path.rglob("progress.csv")), "a seed that learns")
        sent(process.pid, signal.SIGINT)
        _, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130 and not error


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_an_experiment_that_is_ended_alone_leaves_no_seed_behind(tmp_path, number, status):
    with command("experiment", "programmable-2L", "--seeds", "2", "--runs", tmp_path) as process:
        wait_for(lambda: list(tmp_path.rglob("progress.csv")), "a seed that learns")
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == status
        _, error = process.communicate(timeout=DEADLINE_S)
    assert "Traceback" not in error


def test_ctrl_c_ends_a_training_after_its_episode_and_what_it_learned_is_kept(tmp_path):
    train = ("train", "--out", tmp_path, "--eval-every", "0")
    with command(*train) as process:
        wait_for(lambda: "frames" in process.stdout.readline(), "a run that learns")
        sent(process.pid, signal.SIGINT)
        output, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130 and "Traceback" not in error
    frames = int(re.search(r"stopped after ([\d,]+) frames", output)[1].replace(",", ""))
    assert frames > 0 and frames % 100 == 0
    assert main([*map(str, train), "--resume", "--frames", str(frames + 100)]) == 0


def test_a_training_that_nobody_reads_any_more_keeps_what_it_learned(tmp_path):
    """As after `| head`."""
    with command("train", "--out", tmp_path, "--eval-every", "100", "--eval-episodes", "1") as run:
        run.stdout.readline()
        run.stdout.close()
        run.wait(DEADLINE_S)
        assert run.returncode == 141 and "Traceback" not in run.stderr.read()
    assert (tmp_path / "checkpoint" / "LATEST").is_file()


ARENA = "sim_node:\n  ros__parameters:\n    program_source: topic\n"


def in_a_terminal_that_closes(
    said: bytes, *arguments: str, log: Path | None = None, **variables: str
) -> int:
    """Exit status of `pa_ros`, whose terminal is closed when it has said this, and when a node that
    it started writes its log: on a busy machine, one that still starts would have to be killed."""
    master, slave = os.openpty()
    heard = ("env", "--default-signal=HUP,INT,TERM", "setsid", "--ctty")
    process = subprocess.Popen(
        [*heard, sys.executable, "-m", "pa_ros", *arguments],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env={**os.environ, **variables},
    )
    os.close(slave)
    try:
        shown = b""
        while said not in shown:
            shown += os.read(master, 65536)
        wait_for(lambda: log is None or (log.is_file() and log.stat().st_size > 0))
        os.close(master)
        return process.wait(DEADLINE_S)
    finally:
        process.kill()
        process.wait()


def test_a_training_keeps_what_it_learned(tmp_path: Path) -> None:
    arguments = ("train", "--eval-every", "0", "--out", str(tmp_path))
    assert in_a_terminal_that_closes(b" frames ", *arguments) == 130
    assert (tmp_path / "checkpoint" / "LATEST").is_file()


@pytest.mark.graph
def test_a_recording_is_closed_and_a_graph_stopped_node_by_node(tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text(ARENA)
    with DomainClaim() as claim:
        domain = str(claim.number)
        bag, out = str(tmp_path / "bag"), str(tmp_path / "run")
        assert in_a_terminal_that_closes(b"Recording", "record", bag, ROS_DOMAIN_ID=domain) == 0
        launch = ("launch", "--params", str(tmp_path / "arena.yaml"), "--out", out)
        log = tmp_path / "run/log/sim_node.log"
        said = b"started sim_node"
        assert in_a_terminal_that_closes(said, *launch, log=log, ROS_DOMAIN_ID=domain) == 0
    assert (tmp_path / "bag" / "metadata.yaml").is_file()
