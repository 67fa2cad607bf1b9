"""What a goal's client makes of an agent that takes no goals."""

from typing import Any
from unittest.mock import Mock

import pytest

from pa_ros.cli.send import result_text
from pa_ros.tools.send import GoalClient
from pa_ros.wire.program import GoalResult, ProgramGoal, encode_goal_result


def _executed(monkeypatch: pytest.MonkeyPatch, accepted: bool, result: Any) -> GoalResult:
    """What an agent's answers come to."""
    handle, ended = Mock(accepted=accepted), Mock()
    ended.result.return_value = Mock(result=result)
    handle.get_result_async.return_value = ended
    client = Mock()
    client.send_goal_async.return_value.result.return_value = handle
    monkeypatch.setattr("pa_ros.tools.send.ActionClient", lambda *_: client)
    goals = GoalClient(Mock(), lambda _condition, _timeout_s: True)
    return goals.execute(ProgramGoal("NEAR(HAND, RED)", 0.0, 1.0), 5.0)


@pytest.mark.parametrize("accepted", [False, True])
def test_an_agent_that_takes_no_goals_is_said_to_with_what_to_do(monkeypatch, accepted) -> None:
    """Rejected, or accepted and aborted without a word, as where it is cleaned up meanwhile."""
    nothing = type(encode_goal_result(GoalResult(True)))()
    result = _executed(monkeypatch, accepted, nothing)
    assert (result.success, result.code, result.position) == (False, "goal.rejected", -1)
    assert "ros2 lifecycle get" in result_text("NEAR(HAND, RED)", result)


def test_a_result_that_says_why_is_passed_on(monkeypatch) -> None:
    given = GoalResult(False, 0.5, None, "program.syntax", "column 1", 0)
    assert _executed(monkeypatch, True, encode_goal_result(given)) == given
    reached = GoalResult(True, 0.125, 2.0)
    assert _executed(monkeypatch, True, encode_goal_result(reached)) == reached
