"""A goal between its acceptance and its end, by verdicts made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from agent_node.goals import ProgramGoals
from helpers.learners import WORLD
from pa_ros.acting.errors import ActingError
from pa_ros.core.experience import Verdict
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.program import (
    GoalProgress,
    GoalResult,
    ProgramGoal,
    ProgramStatus,
    decode_goal_feedback,
    decode_goal_result,
    encode_goal,
    encode_program_status,
)
from pa_ros.wire.step import encode_verdict

SCENE = np.zeros((3, WORLD.object_features), np.float32)
TEXT = "NEAR(HAND, AND(RED, CUBE))"


class Pursuing:
    """A node that serves goals without a graph."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.heard: dict[str, Any] = {}  # callbacks by topic
        self.sent: list[Any] = []  # programs
        self.results: list[GoalResult] = []
        self.told: list[GoalProgress] = []
        self.refusals = Refusals(lambda _: None)
        monkeypatch.setattr("agent_node.goals.GoalServer", self._serve)
        monkeypatch.setattr("agent_node.goals.steady_timer", lambda _, s, tell: self._every(tell))
        node = Mock()
        node.get_name.return_value, node.get_fully_qualified_name.return_value = "a", "/a"
        node.create_subscription = lambda _, name, callback, *rest, **more: self.heard.update(
            {name: callback}
        )
        node.create_publisher.return_value = SimpleNamespace(publish=self.sent.append)
        node.count_publishers.return_value = 1
        self.acting: Any = SimpleNamespace(
            agent=Mock(), refusals=self.refusals, active=True, arena=Mock(world=WORLD), seen=None
        )
        ProgramGoals(node, self.acting)

    def _every(self, tell: Any) -> None:
        self.tell = tell

    def _serve(self, node: Any, action: Any, start: Any, cancel: Any) -> None:
        self.start = start

    def pursue(self) -> None:
        wanted = ProgramGoal(TEXT, 0.0, 1.0)
        ends = {"abort": self._ended, "succeed": self._ended, "feedback": self._told}
        self.start(Mock(request=encode_goal(wanted), **ends))

    def _told(self, message: Any) -> None:
        self.told.append(decode_goal_feedback(message))

    def _ended(self, result: Any) -> None:
        self.results.append(decode_goal_result(result))

    def judge(self, stamp_ns: int) -> None:
        """The arena accepts the program that was sent last."""
        program_id = self.sent[-1].program_id
        judgement = ProgramStatus(program_id, "/sim_node", True, canonical=TEXT, stamp_ns=stamp_ns)
        self.heard["program_status"](encode_program_status(judgement))

    def verdict(self, arena: str, stamp_ns: int, program_id: str = "another's") -> None:
        given = Verdict(0, 1, stamp_ns, program_id, -1.0, False, 0.5, False)
        self.heard["verdict"](encode_verdict(given, arena_id=arena))


@pytest.fixture
def goals(monkeypatch: pytest.MonkeyPatch) -> Pursuing:
    return Pursuing(monkeypatch)


def test_a_goal_ends_when_its_arena_was_started_anew_before_the_first_step_under_it(goals) -> None:
    goals.pursue()
    assert not goals.sent  # until verdicts are heard
    goals.verdict("one", 5_000_000_000)
    goals.judge(5_000_000_000)
    goals.verdict("other", 100_000_000)
    (result,) = goals.results
    assert (result.success, result.code) == (False, "goal.arena_gone")
    assert "expected verdicts of the arena 'one', got 'other'" in result.reason
    assert goals.refusals.counts == {"goal.arena_gone": 1}


def test_a_goal_sent_as_its_arena_is_started_anew_is_pursued_in_the_new_one(goals) -> None:
    goals.pursue()
    goals.verdict("one", 5_000_000_000)  # its last: the program that is sent then is heard by none
    goals.verdict("other", 100_000_000)
    assert not goals.results
    goals.judge(100_000_000)
    goals.verdict("other", 200_000_000, goals.sent[-1].program_id)
    assert not goals.results
    goals.verdict("third", 300_000_000)
    assert goals.results.pop().code == "goal.arena_gone"


def test_a_step_that_the_weights_have_no_degrees_for_ends_no_agent(goals) -> None:
    """As of an arena that was started anew, with another arm."""
    observation, program = Mock(objects=SCENE, hand_index=0), Mock()
    goals.acting.agent.version = 3
    goals.acting.agent.relevance.side_effect = ActingError("policy: expected 18, got 21")
    goals.pursue()
    goals.verdict("one", 1_000_000_000)
    observation.program_id = goals.sent[-1].program_id
    goals.acting.seen = observation, program
    goals.tell()
    assert goals.refusals.counts == {ActingError.code: 1}
    assert not goals.results and not goals.told[-1].relevance


def test_each_goal_is_pursued_in_the_arena_whose_verdicts_come_when_it_is_sent(goals) -> None:
    for arena, known in (("one", False), ("other", True)):
        if known:  # the second goal's program is sent at once
            goals.verdict(arena, 1_000_000_000)
        goals.pursue()
        goals.verdict(arena, 2_000_000_000)
        goals.judge(2_000_000_000)
        for stamp_ns in (2_100_000_000, 2_200_000_000):
            goals.verdict(arena, stamp_ns, goals.sent[-1].program_id)
        assert not goals.results
        goals.verdict("third", 2_300_000_000)
        assert goals.results.pop().code == "goal.arena_gone"
