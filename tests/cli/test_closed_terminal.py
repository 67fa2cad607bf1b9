"""What runs in a terminal that is closed comes to its end in order, though nobody can be told."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.waiting import DEADLINE_S
from pa_ros.tools.domain import DomainClaim

ARENA = "sim_node:\n  ros__parameters:\n    program_source: topic\n"


def in_a_terminal_that_closes(said: bytes, *arguments: str, **variables: str) -> int:
    """Exit status of `pa_ros`, whose terminal is closed when it has said this."""
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
        domain = {"ROS_DOMAIN_ID": str(claim.number)}
        bag, out = str(tmp_path / "bag"), str(tmp_path / "run")
        assert in_a_terminal_that_closes(b"Recording", "record", bag, **domain) == 0
        launch = ("launch", "--params", str(tmp_path / "arena.yaml"), "--out", out)
        assert in_a_terminal_that_closes(b"started sim_node", *launch, **domain) == 0
    assert (tmp_path / "bag" / "metadata.yaml").is_file()
