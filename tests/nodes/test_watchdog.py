"""In real time a command holds for a while, and never beyond its episode."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pa_ros.core.experience import Step
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import Command
from sim_node.commands import Watchdog
from sim_node.config import SimConfig
from sim_node.session import Session, SimError

PERIOD_NS = 100_000_000


@pytest.fixture
def session() -> Session:
    made = Session(SimConfig(mode="real_time"), "x")
    made.begin()
    return made


@pytest.fixture
def watchdog(session: Session) -> Watchdog:
    """Commands hold for three control periods."""
    return Watchdog(session, 0.3)


def command(session: Session, age: int = 0, **fields: Any) -> Command:
    """To turn the first joint at full speed; an answer to the step `age` periods ago."""
    stands = session.current.observation
    stamp_ns = stands.stamp_ns - age * PERIOD_NS
    action = np.array([1, 0, 0, 0, 0, 0], np.float32)
    answer = Command(stands.episode, stands.step, stamp_ns, "me", 0, action)
    return replace(answer, **fields)


def tick(watchdog: Watchdog, session: Session) -> Step:
    frame = watchdog.tick()
    session.finish_step()
    return frame


def speed(frame: Step) -> float:
    return float(np.abs(frame.observation.joint_velocity).max())


def test_a_command_is_repeated_for_its_time_and_then_the_arm_holds_still(session, watchdog) -> None:
    watchdog.offer(command(session))
    assert all(speed(tick(watchdog, session)) > 0.5 for _ in range(4))  # ages 0, 1, 2 and 3
    assert watchdog.holds == 0
    for _ in range(3):
        last = tick(watchdog, session)
    assert speed(last) < 0.05 and watchdog.holds == 3


def test_only_the_step_that_a_command_answers_counts_as_executed(session, watchdog) -> None:
    """What a held-over command leads to is nobody's choice at that step."""
    watchdog.offer(command(session))
    assert [bool(tick(watchdog, session).executed) for _ in range(3)] == [True, False, False]
    watchdog.offer(command(session, age=1))
    assert tick(watchdog, session).executed is None


def test_a_command_does_not_reach_beyond_a_reset(session: Session, watchdog: Watchdog) -> None:
    """Not even to the same episode."""
    watchdog.offer(command(session))
    tick(watchdog, session)
    session.begin(ResetRequest(0))
    frame = tick(watchdog, session)
    assert speed(frame) < 0.05 and frame.executed is None
    assert watchdog.holds == 1


@pytest.mark.parametrize("eval_every", [0, 1])
def test_a_command_does_not_reach_into_the_next_episode(eval_every: int) -> None:
    """Not even where an evaluation episode has the same number."""
    config = SimConfig(mode="real_time", episode_steps=2, eval_every_episodes=eval_every)
    session = Session(config, "x")
    session.begin()
    watchdog = Watchdog(session, 1.0)
    watchdog.offer(command(session))
    for _ in range(2):
        tick(watchdog, session)
    assert session.current.observation.step == 0 and session.current.evaluation == bool(eval_every)
    assert speed(tick(watchdog, session)) < 0.05


def test_commands_that_are_old_out_of_order_or_for_another_episode_are_rejected(session, watchdog):
    for _ in range(5):
        tick(watchdog, session)
    watchdog.offer(command(session, age=3))
    watchdog.offer(command(session, age=2))
    for wrong in (
        command(session, age=4),  # too old
        command(session, age=3),  # older than one taken before
        command(session, age=-1),  # an answer to what is not yet
        command(session, episode=1),
    ):
        with pytest.raises(SimError, match="a stamp from"):
            watchdog.offer(wrong)
    watchdog.offer(command(session, age=2))  # the same again


def test_without_a_program_nothing_moves_and_no_hold_is_counted() -> None:
    session = Session(SimConfig(mode="real_time", program_source="topic"), "x")
    session.begin()
    watchdog = Watchdog(session, 0.3)
    with pytest.raises(SimError, match="program first"):
        watchdog.offer(command(session))
    assert speed(tick(watchdog, session)) < 0.05 and watchdog.holds == 0
    session.submit(ProgramRequest("mine", "NEAR(HAND, RED)"))
    watchdog.offer(command(session))
    assert speed(tick(watchdog, session)) > 0.5
