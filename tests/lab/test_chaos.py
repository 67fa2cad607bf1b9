"""Fault injection: rows, tables, orphans, what counts as lost, and a real arm that is attacked."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import numpy as np
import pytest

from chaos.arm import REST_S, TICK_S, PushedArm, Record
from chaos.campaign import Row, all_faults, chosen, write_table
from chaos.cycles import SHARED_MEMORY, Cycle, orphans, run_cycle, shared_memory
from chaos.faults import Fault
from chaos.observer import Ledger
from chaos.robot import AT_REST_S, Rig
from chaos.stage import MARK, Stage, staged
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import AgentKey

FAULT = Fault("x | y", lambda _: None)


def row(**outcome: Any) -> Row:
    return Row(FAULT, [Cycle(FAULT.name, 0.0, seen_after=1.0, recovered_after=2.0, **outcome)])


def test_the_table_is_written_between_its_markers(tmp_path: Path):
    rows = [row(), row(lost=2), row(failures=["a", "a", "b"]), Row(FAULT)]
    page = tmp_path / "F.md"
    kept = "| recorder: SIGKILL **failed**: a | – | 0.8 |"
    old = f"| Fault |\n{kept}\n| a fault of former times | – | 0.8 |\n"
    page.write_text(f"# Faults\n\n<!-- make chaos -->\n{old}<!-- end -->\n\n## More\n")
    write_table(page, rows)
    text = page.read_text()
    assert text.startswith("# Faults\n") and text.endswith("<!-- end -->\n\n## More\n")
    assert text.splitlines()[5:-3] == [
        kept,
        "| x / y | 1.0 | 2.0 |",
        "| x / y **failed**: 2 trajectories lost | 1.0 | 2.0 |",
        "| x / y **failed**: a; b | 1.0 | 2.0 |",
    ]


def test_faults_have_unique_names_and_are_chosen_by_parts_of_them():
    names = [fault.name for fault in all_faults()]
    assert len(set(names)) == len(names) == 107
    assert {f.name for f in chosen(["recorder: SIG"])} == {
        "recorder: SIGKILL", "recorder: SIGTERM", "recorder: SIGSTOP 5 s",
        "launched recorder: SIGKILL",
    }  # fmt: skip
    assert len(chosen(short=True)) == 3
    with pytest.raises(ConfigError, match="expected parts of faults' names"):
        chosen(["no such fault"])


def test_processes_and_shared_memory_are_found_by_the_mark():
    hold = """from multiprocessing import shared_memory
memory = shared_memory.SharedMemory(create=True, size=64)
print(memory.name, flush=True)
input()
memory.unlink()"""
    environment = {**os.environ, MARK: "here"}
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, env=environment,
                          text=True) as process:  # fmt: skip
        assert process.stdin is not None and process.stdout is not None
        name = process.stdout.readline().strip()
        assert process.pid in orphans("here") and not orphans("elsewhere")
        assert shared_memory("here") == {SHARED_MEMORY / name}
        process.stdin.write("\n")
    assert process.pid not in orphans("here")


@pytest.mark.graph
def test_a_real_arm_stops_when_robot_node_is_stopped_or_its_relay_killed(tmp_path: Path):
    with staged(tmp_path, 0, "robot", Rig) as rig:
        for fault in chosen(["real arm, robot_node: SIGSTOP", "its relay: SIGKILL"]):
            cycle = run_cycle(rig, replace(fault, hold_s=AT_REST_S + 2 * REST_S))
            assert not cycle.failures and cycle.recovered_after is not None
            assert "at rest after 0.0" not in cycle.note, "it moved"


@pytest.mark.parametrize(
    ("harm", "says"),
    [
        ({"outside_m": 0.021}, "outside its box by 21.0 mm"),
        ({"commanded": 1.02}, "1.020 of the speed limit commanded"),
        ({"real": np.inf}, "at inf of the speed limit"),
    ],
)
def test_an_arm_outside_its_box_or_too_fast_is_a_failure(harm, says):
    rig: Any = SimpleNamespace(
        arm=SimpleNamespace(record=Record(0.019, 1.0, 1.009)), worst=Record()
    )
    assert Rig.harm(rig)[1] == []
    rig.arm.record.add(Record(**harm))
    assert Rig.harm(rig)[1] == [says]


@pytest.mark.parametrize(
    ("speeds", "rest"),
    [
        ([1.0] * 20 + [0.0] * 40, (0.2, True)),
        ([1.0] * 20 + [0.0] * 20 + [1.0] * 30, (None, False)),  # it turned back
        ([1.0] * 20 + [0.0] * 40 + [1.0] * 15, (0.2, False)),
    ],
)
def test_an_arm_is_at_rest_when_it_is_slow_for_a_while(speeds, rest):
    samples = [(10 + TICK_S * (i + 1), speed) for i, speed in enumerate(speeds)]
    seconds, stayed = PushedArm.rest(cast(PushedArm, SimpleNamespace(trace=samples)), 10.0)
    assert (seconds and round(seconds, 3), stayed) == rest


@pytest.mark.parametrize("stalled", [False, True])
def test_a_harmless_fault_may_be_reported_only_if_this_process_was_stalled(stalled):
    stage = MagicMock(learns=False, progress=0, stalled=stalled)
    stage.until.side_effect = lambda condition, _: condition()
    stage.observer.first_report = 0.0, "robot_node: holds"
    stage.harm.return_value = "", []
    cycle = run_cycle(stage, replace(FAULT, harmless=True, silent="x"))
    assert any("harmless" in failure for failure in cycle.failures) is not stalled


AGENT = AgentKey("a", 1)


def ledger(sent: int, accounted: int, version: int) -> Ledger:
    found = Ledger()
    found.published(AGENT, sent - 1)
    found.learned(version, {AGENT: accounted})
    return found


def test_a_trajectory_is_learned_reported_in_flight_or_lost():
    assert ledger(8, 8, 8).unexplained({"a"}, 0) == 0
    assert ledger(8, 6, 6).unexplained({"a"}, 0) == 0  # two are in flight
    assert ledger(8, 6, 6).unexplained({"b"}, 0) == 2  # but their agent is dead
    assert ledger(8, 8, 6).unexplained({"a"}, 0) == 2
    assert ledger(8, 8, 6).unexplained({"a"}, 2) == 0
    assert ledger(8, 8, 9).unexplained({"a"}, 0) == -1  # learned, but never published


def test_the_last_trajectory_of_a_killed_agent_may_have_reached_the_learner_only():
    assert ledger(8, 9, 9).unexplained({"b"}, 0) == 0
    assert ledger(8, 9, 9).unexplained({"a"}, 0) == -1  # a living agent's reaches everyone
    assert ledger(8, 10, 10).unexplained({"b"}, 0) == -1  # it was one at most


def test_what_a_killed_learner_forgot_is_no_loss_beyond_its_checkpoint():
    found = ledger(8, 8, 8)
    found.learned(5, {AGENT: 5})  # it resumed from its newest checkpoint
    assert found.unexplained({"b"}, 0) == 0
    found.published(AGENT, 9)
    assert found.unexplained({"b"}, 0) == 2  # these reached no learner


@pytest.mark.parametrize(("latest", "versions"), [("", []), ("version-000000060", [60, 40])])
def test_an_unfinished_checkpoint_does_not_count(tmp_path, latest, versions):
    for version in (40, 60, 80):
        folder = tmp_path / f"version-{version:09d}"
        folder.mkdir()
        (folder / "metadata.json").touch()
    if latest:
        (tmp_path / "LATEST").write_text(latest)
    assert Stage.versions(cast(Stage, SimpleNamespace(checkpoint=tmp_path))) == versions
