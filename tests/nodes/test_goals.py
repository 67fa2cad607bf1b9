"""A goal between its acceptance and its end, with invented steps."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from agent_node.goals import ProgramGoals
from helpers.learners import WORLD
from helpers.messages import judged
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.program import (
    GoalResult,
    ProgramGoal,
    ProgramStatus,
    decode_goal_result,
    encode_goal,
    encode_program_status,
)

TEXT = "NEAR(HAND, AND(RED, CUBE))"


class Executing:
    """ProgramGoals of an agent without a graph."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.callbacks: dict[str, Any] = {}  # by topic
        self.sent: list[Any] = []  # programs
        self.results: list[GoalResult] = []
        self.node = Mock(arena=Mock(world=WORLD, arena_id="one"), seen=None, active=True)
        self.node.refusals = Refusals(lambda _: None)
        self.node.agent.version = 1
        self.node.get_name.return_value, self.node.count_publishers.return_value = "a", 1
        self.node.create_publisher.return_value = SimpleNamespace(publish=self.sent.append)
        self.node.subscribe = lambda topic, react: self.callbacks.update({topic.name: react})

        def serve(node: Any, refusals: Any, action: Any, start: Any, cancel: Any) -> None:
            self.start = start

        def every(node: Any, period_s: float, tick: Any) -> None:
            self.tick = tick

        monkeypatch.setattr("agent_node.goals.GoalServer", serve)
        monkeypatch.setattr("agent_node.goals.steady_timer", every)
        self.goals = ProgramGoals(self.node)

    def execute(self) -> None:
        self.start(Mock(request=encode_goal(ProgramGoal(TEXT, 0.0, 1.0)),
                        abort=self._end, succeed=self._end))  # fmt: skip

    def _end(self, result: Any) -> None:
        self.results.append(decode_goal_result(result))

    def accept(self) -> None:
        """The arena accepts the program that was sent last."""
        status = ProgramStatus(self.sent[-1].program_id, "/sim_node", True, TEXT, stamp_ns=0)
        self.callbacks["program_status"](encode_program_status(status))

    def step(self, arena: str, stamp_s: float) -> None:
        given = judged(1, False, int(stamp_s * 1e9), program_id="another's")
        self.goals.observe(replace(given, arena_id=arena))


@pytest.fixture
def goals(monkeypatch: pytest.MonkeyPatch) -> Executing:
    return Executing(monkeypatch)


def test_a_program_that_no_arena_answers_is_sent_again(goals, monkeypatch, clock):
    monkeypatch.setattr("agent_node.goals.time.monotonic", clock)
    goals.execute()
    assert not goals.sent  # until steps arrive: the first one under it must not be missed
    goals.step("one", 1.0)
    clock.now += 2.0
    goals.tick()
    assert len(goals.sent) == 2
    goals.accept()
    clock.now += 2.0
    goals.tick()
    assert len(goals.sent) == 2


def test_a_goal_ends_with_its_arena(goals):
    goals.execute()
    goals.step("one", 5.0)
    goals.accept()
    goals.step("other", 0.1)  # ignored, as long as the first is followed
    assert not goals.results
    goals.node.arena = Mock(world=WORLD, arena_id="other")
    goals.tick()
    (result,) = goals.results
    assert (result.success, result.code) == (False, "goal.arena_gone")
    assert goals.node.refusals.counts == {"goal.arena_gone": 1}
    goals.execute()  # the next goal is executed in the new arena
    goals.step("other", 0.2)
    goals.node.count_publishers.return_value = 0
    goals.tick()
    assert len(goals.sent) == 2 and goals.results[-1].code == "goal.arena_gone"
