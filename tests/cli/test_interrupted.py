"""Ctrl-C ends what trains, too."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from waiting import DEADLINE_S, wait_for


def sent(group: int, number: int) -> bool:
    """Whether anybody is left of a process group to get a signal."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    return True


def test_ctrl_c_ends_an_experiment_with_the_seeds_that_were_to_follow(tmp_path):
    options = ("programmable-2L", "--seeds", "9", "--runs", str(tmp_path))
    heard = ("env", "--default-signal=INT")  # pytest-xdist's processes ignore it, and so their own
    command = [*heard, sys.executable, "-m", "pa_ros", "experiment", *options]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        try:
            wait_for(lambda: list(tmp_path.rglob("progress.csv")), "a seed that learns")
            sent(process.pid, signal.SIGINT)
            process.communicate(timeout=DEADLINE_S)
            wait_for(lambda: not sent(process.pid, 0), "the end of all processes")
        finally:
            sent(process.pid, signal.SIGKILL)
    assert process.returncode == 130
    assert len(list(tmp_path.rglob("progress.csv"))) == 1
