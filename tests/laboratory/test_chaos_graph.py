"""Harm done to a live graph, in short: it recovers, and nothing is lost or mis-joined."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from helpers.recordings import pa_ros
from helpers.waiting import DEADLINE_S

pytestmark = pytest.mark.graph


def test_a_short_campaign_holds(tmp_path: Path) -> None:
    figures, table = tmp_path / "chaos.json", tmp_path / "FAULTS.md"
    with pa_ros("chaos", "--short", "--json", figures, "--table", table) as process:
        try:
            out, err = process.communicate(timeout=2 * DEADLINE_S)
        finally:
            process.kill()
    found = json.loads(figures.read_text())
    assert process.returncode == 0, out + err
    assert found["chaos.cycles"] == found["chaos.rows"] == 3
    assert found["chaos.lost"] == found["chaos.mis_joined"] == found["chaos.failed_rows"] == 0
    assert "| agent_node: SIGKILL | 1 |" in table.read_text()
    assert "re-enacted" in out and "0 trajectories denied" in out
