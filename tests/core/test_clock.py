"""Stamps whose differences matter come from a clock that never jumps."""

import re
import time
from pathlib import Path

import pytest

from pa_ros.core.clock import now_ns

ROOT = Path(__file__).parents[2]
ON_THE_WALL = {
    "pa_ros/pa_ros/core/clock.py",  # reads it once, when a process begins
    "pa_ros/pa_ros/tools/record.py",  # converts the middleware's times
    # Controllers and tools compare these stamps with their own ROS clock.
    "agent_node/agent_node/outputs.py",
    "pa_ros/pa_ros/ros/health.py",
    "sim_node/sim_node/robot/output.py",
    "sim_node/sim_node/robot/relay.py",
}
ON_A_STEADY_CLOCK = {"pa_ros/pa_ros/ros/executor.py"}


def test_a_wall_clock_that_is_set_changes_no_difference(monkeypatch) -> None:
    before, began = now_ns(), time.monotonic_ns()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    assert 0 <= now_ns() - before - (time.monotonic_ns() - began) < 10**8


@pytest.mark.parametrize(
    ("calls", "allowed"),
    [
        (r"\btime\.time(_ns)?\(|from time import|datetime|system_clock|\.get_clock\(", ON_THE_WALL),
        (r"\bcreate_(timer|rate)\(", ON_A_STEADY_CLOCK),
    ],
)
def test_no_other_source_reads_the_wall_clock(calls: str, allowed: set[str]) -> None:
    folders = ("pa_ros/pa_ros", "sim_node", "agent_node", "learner_node", "docs/examples")
    files = [
        file
        for folder in folders
        for end in ("py", "cpp")
        for file in (ROOT / folder).rglob(f"*.{end}")
    ]
    calling = {str(file.relative_to(ROOT)) for file in files if re.search(calls, file.read_text())}
    assert len(files) > 200 and calling == allowed
