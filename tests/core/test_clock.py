"""Stamps whose differences matter come from a clock that never jumps."""

import time
from pathlib import Path

from pa_ros.core.clock import now_ns

ROOT = Path(__file__).parents[2]
ON_THE_WALL = {  # they compare with, or send to, a program that uses the wall clock
    "pa_ros/pa_ros/core/clock.py",
    "pa_ros/pa_ros/tools/record.py",
    "sim_node/sim_node/robot/output.py",
    "sim_node/sim_node/robot/relay.py",
}


def test_a_wall_clock_that_is_set_changes_no_difference(monkeypatch) -> None:
    before, began = now_ns(), time.monotonic_ns()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    assert 0 <= now_ns() - before - (time.monotonic_ns() - began) < 10**8


def test_no_other_source_reads_the_wall_clock() -> None:
    packages = ("pa_ros/pa_ros", "sim_node", "agent_node", "learner_node")
    files = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    reading = {
        str(file.relative_to(ROOT))
        for file in files
        if any(call in file.read_text() for call in ("time.time(", "time.time_ns(", "datetime"))
    }
    assert len(files) > 200 and reading == ON_THE_WALL
