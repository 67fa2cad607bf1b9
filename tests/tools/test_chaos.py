"""What a campaign of faults counts, without a graph: rows, plans, orphans, accounts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.tools.chaos.campaign import ChaosConfig, Row, all_faults, chosen, failed_rows
from pa_ros.tools.chaos.cycles import Cycle
from pa_ros.tools.chaos.faults import Fault
from pa_ros.tools.chaos.invariants import orphans
from pa_ros.tools.chaos.report import report, write_table

FAULT = Fault("x | y", lambda _: None)


def row(**outcome: Any) -> Row:
    return Row(FAULT, [Cycle(FAULT.name, 0.0, seen_after=1.0, recovered_after=2.0, **outcome)])


@pytest.mark.parametrize(
    "outcome", [{"lost": 1}, {"mis_joined": 2}, {"failures": ["the arm moved"]}]
)
def test_a_row_fails_if_anything_did_not_hold(outcome):
    assert row(**outcome).failed and failed_rows([row(), row(**outcome)]) == 1
    assert not row().failed


def test_figures_and_table_say_what_was_done(tmp_path: Path):
    rows = [row(), row(lost=2), row(failures=["a", "a", "b"]), Row(FAULT)]
    assert report(rows) == {
        "chaos.cycles": 3, "chaos.rows": 3, "chaos.lost": 2, "chaos.mis_joined": 0,
        "chaos.failed_rows": 2,
    }  # fmt: skip
    write_table(tmp_path / "F.md", rows, "pa_ros chaos")
    lines = (tmp_path / "F.md").read_text().splitlines()
    assert lines[-3:] == [
        "| x / y | 1 | 1.0 | 2.0 | 0 | 0 | held |",
        "| x / y | 1 | 1.0 | 2.0 | 2 | 0 | **failed**: trajectories lost or mis-joined |",
        "| x / y | 1 | 1.0 | 2.0 | 0 | 0 | **failed**: a; b |",
    ]
    assert "`pa_ros chaos` (3 cycles, 2 of 3 rows failed)" in "\n".join(lines)


def test_every_row_has_a_name_of_its_own_and_all_processes_are_hurt():
    names = [fault.name for fault in all_faults()]
    assert len(set(names)) == len(names) > 40
    for process in ("sim_node", "agent_node", "learner_node", "recorder"):
        for harm in ("SIGKILL", "SIGTERM", "SIGSTOP 5 s", "restart", "started twice"):
            assert f"{process}: {harm}" in names


def test_rows_are_chosen_by_parts_of_their_names():
    assert {f.name for f in chosen(ChaosConfig(only=("recorder: SIG",)))} == {
        "recorder: SIGKILL", "recorder: SIGTERM", "recorder: SIGSTOP 5 s",
        "launched recorder: SIGKILL",
    }  # fmt: skip
    assert len(chosen(ChaosConfig(short=True))) == 3
    with pytest.raises(ConfigError, match="no row"):
        chosen(ChaosConfig(only=("nothing like it",)))


def test_a_process_that_was_left_behind_is_found_by_its_mark():
    environment = {**os.environ, "PA_ROS_CHAOS": "here"}
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE,
                          env=environment) as process:  # fmt: skip
        try:
            assert process.pid in orphans("here", "PA_ROS_CHAOS")
            assert process.pid not in orphans("elsewhere", "PA_ROS_CHAOS")
        finally:
            process.kill()
    assert process.pid not in orphans("here", "PA_ROS_CHAOS")
