"""What a campaign of faults counts, without a graph: rows, plans, orphans, accounts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from chaos.campaign import ChaosConfig, Row, all_faults, chosen, failed_rows
from chaos.cycles import Cycle
from chaos.faults import Fault
from chaos.invariants import SHARED_MEMORY, orphans, shared_memory
from chaos.ledger import Ledger
from chaos.report import report, write_table
from chaos.stage import Stage
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import AgentKey

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
    with (tmp_path / "F.md").open("a") as file:
        file.write("\n## More\n\nkept\n")
    write_table(tmp_path / "F.md", rows[:1], "pa_ros chaos")
    assert (tmp_path / "F.md").read_text().endswith("| held |\n\n## More\n\nkept\n")


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


def test_shared_memory_is_known_by_the_processes_that_hold_it():
    hold = """from multiprocessing import shared_memory
memory = shared_memory.SharedMemory(create=True, size=64)
print(memory.name, flush=True)
input()
memory.unlink()"""
    environment = {**os.environ, "PA_ROS_CHAOS": "held"}
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, env=environment,
                          text=True) as process:  # fmt: skip
        assert process.stdin is not None and process.stdout is not None
        name = process.stdout.readline().strip()
        assert shared_memory("held", "PA_ROS_CHAOS") == {SHARED_MEMORY / name}
        assert shared_memory("elsewhere", "PA_ROS_CHAOS") == set()
        process.stdin.write("\n")


AGENT = AgentKey("a", 1)


def ledger(sent: int, accounted: int, version: int, agent: AgentKey = AGENT) -> Ledger:
    found = Ledger()
    found.sent(agent, sent - 1)
    found.learned(version, {agent: accounted})
    return found


def test_what_is_sent_is_learned_told_of_under_way_or_lost():
    assert ledger(8, 8, 8).unexplained({"a"}, 0) == 0
    assert ledger(8, 6, 6).unexplained({"a"}, 0) == 0  # two are under way
    assert ledger(8, 6, 6).unexplained({"b"}, 0) == 2  # and their agent is gone
    assert ledger(8, 8, 6).unexplained({"a"}, 0) == 2
    assert ledger(8, 8, 6).unexplained({"a"}, 2) == 0
    assert ledger(8, 8, 9).unexplained({"a"}, 0) == -1  # learned, and never sent


def test_a_trajectory_that_was_being_sent_when_its_agent_was_killed_may_be_heard_by_some():
    assert ledger(8, 9, 9).unexplained({"b"}, 0) == 0
    assert ledger(8, 9, 9).unexplained({"a"}, 0) == -1  # a living one's is heard by all
    assert ledger(8, 10, 10).unexplained({"b"}, 0) == -1  # it was one at most


def test_what_a_killed_learner_had_learned_of_a_dead_agent_is_of_the_lost_checkpoint():
    found = ledger(8, 8, 8)
    found.learned(5, {AGENT: 5})  # it began again from its newest checkpoint
    assert found.unexplained({"b"}, 0) == 0
    found.sent(AGENT, 9)
    assert found.unexplained({"b"}, 0) == 2  # what no learner ever had


@pytest.mark.parametrize(
    ("latest", "at_hand"),
    [("", []), ("version-000000060", [60, 40]), ("version-000000080", [80, 60, 40])],
)
def test_a_checkpoint_that_latest_does_not_name_yet_is_not_at_hand(tmp_path, latest, at_hand):
    for version in (40, 60, 80):
        folder = tmp_path / f"version-{version:09d}"
        folder.mkdir()
        (folder / "metadata.json").touch()
    if latest:
        (tmp_path / "LATEST").write_text(latest)
    stage = cast(Stage, SimpleNamespace(checkpoint=tmp_path))
    assert Stage.versions(stage) == at_hand
