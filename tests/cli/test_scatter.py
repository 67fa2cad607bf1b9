"""`pa_ros scatter` asks again until the robot finds its blocks."""

from unittest.mock import MagicMock

import pytest

from pa_ros.cli.main import main
from pa_ros.core.errors import PaError


def test_it_asks_again_until_the_robot_continues(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    arm = MagicMock()
    arm.__enter__.return_value = arm
    arm.scatter.return_value = "the arm holds"
    missing = PaError("resume: rejected: expected 4 objects on the table", "arena.service")
    arm.scattered.side_effect = [missing, "continues with red_cube"]
    monkeypatch.setattr("pa_ros.cli.scatter.Arm", lambda namespace: arm)
    asked = MagicMock(return_value="")
    monkeypatch.setattr("builtins.input", asked)
    assert main(["scatter", "--namespace", "left"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told == ["the arm holds", str(missing), "continues with red_cube"]
    assert asked.call_count == 2
