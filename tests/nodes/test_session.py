"""Which episode runs next, under which program."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from pa_ros.arena import ArenaError, ReachTask, design_named, preset_named
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import CommandKey, Executed, Step
from pa_ros.language import ProgramError
from pa_ros.wire import WireError
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import Command
from sim_node.commands import check_answer
from sim_node.config import SimConfig
from sim_node.session import Session, SimError


def step(session: Session) -> Step:
    """Run one control period while the arm holds still; the step it led to."""
    frame = session.advance(session.hold)
    session.finish_step()
    return frame


def run_episodes(session: Session, count: int) -> list[tuple[bool, int, str]]:
    """(evaluation, index, program id) of the next `count` episodes."""
    session.begin()
    found = []
    while len(found) < count:
        frame = session.current
        found.append((frame.evaluation, frame.observation.episode, frame.observation.program_id))
        for _ in range(session.arena.episode_steps):
            step(session)
    return found


def test_evaluation_episodes_are_interleaved_and_numbered_apart():
    config = SimConfig(episode_steps=2, eval_every_episodes=2)
    assert run_episodes(Session(config, "x"), 7) == [
        (False, 0, "x/train/0"), (False, 1, "x/train/1"), (True, 0, "x/eval/0"),
        (False, 2, "x/train/2"), (False, 3, "x/train/3"), (True, 1, "x/eval/1"),
        (False, 4, "x/train/4"),
    ]  # fmt: skip


def test_a_resumed_arena_continues_with_the_same_episodes():
    config = SimConfig(episode_steps=2, eval_every_episodes=2)
    resumed = SimConfig(episode_steps=2, eval_every_episodes=2, first_episode=4)
    assert run_episodes(Session(config, "x"), 9)[6:] == run_episodes(Session(resumed, "x"), 3)


def test_training_episodes_are_those_of_the_task_itself():
    session = Session(SimConfig(seed=5, eval_every_episodes=1, episode_steps=3), "x")
    run_episodes(session, 2)
    task = ReachTask(preset_named("fast"), design_named("2-L"), 5)
    expected, _ = task.reset(1)
    assert session.current.observation.episode == 1 and not session.current.evaluation
    assert np.array_equal(session.current.observation.objects, expected.objects)
    assert session.program.program == task.program


def test_a_persons_program_lasts_until_the_generators_next_episode():
    session = Session(SimConfig(episode_steps=3), "x")
    session.begin()
    drawn = session.current.program
    assert session.submit(ProgramRequest("mine", "NEAR(HAND,RED)")) == "NEAR(HAND, RED)"
    assert session.current.program == drawn  # if the current step is sent again
    for frame in [step(session) for _ in range(3)]:
        assert (frame.observation.program_id, frame.program) == ("mine", "NEAR(HAND, RED)")
    assert session.current.observation.program_id == "x/train/1"


def test_with_programs_by_topic_the_scene_and_the_program_stay():
    session = Session(SimConfig(program_source="topic"), "x")
    frame = session.begin()
    assert frame.observation.program_id == frame.program == "" and not frame.verdict.satisfied
    stamp = frame.observation.stamp_ns
    session.submit(ProgramRequest("mine", "NEAR(HAND, RED)"))
    assert session.current.observation.program_id == "mine"
    assert session.current.observation.stamp_ns == stamp  # the same step, now under a program
    with pytest.raises(ProgramError):
        session.submit(ProgramRequest("no", "NEAR(HAND, AND(RED, BLUE))"))
    for _ in range(150):
        frame = step(session)
    assert (frame.observation.episode, frame.observation.step) == (0, 150)
    assert frame.observation.program_id == "mine"
    session.begin(ResetRequest(episode=8))
    assert session.current.observation.program_id == "mine"


def test_a_rejected_reset_changes_nothing():
    session = Session(SimConfig(), "x")
    session.begin()
    before = session.current
    with pytest.raises(ProgramError):
        session.begin(ResetRequest(3, "NEAR(HAND, AND(RED, BLUE))"))
    assert session.current is before and session.task.episode.index == 0
    frame = step(session)
    assert (frame.observation.episode, frame.observation.step) == (0, 1)


def test_a_program_id_keeps_its_text_and_the_arenas_prefix_is_reserved():
    session = Session(SimConfig(episode_steps=3), "x")
    session.begin()
    red, blue = (ProgramRequest("mine", f"NEAR(HAND, {word})") for word in ("RED", "BLUE"))
    session.submit(red)
    assert session.submit(replace(red, text="NEAR(HAND,RED)")) == "NEAR(HAND, RED)"  # the same
    with pytest.raises(WireError, match=r"'mine', which means NEAR\(HAND, RED\), received"):
        session.submit(blue)
    with pytest.raises(WireError, match="does not begin with 'x/'"):
        session.submit(replace(blue, program_id="x/train/77"))
    with pytest.raises(ProgramError):
        session.submit(ProgramRequest("refused", "NEAR(HAND, AND(RED, BLUE))"))
    assert session.program.text == "NEAR(HAND, RED)"
    assert session.submit(replace(blue, program_id="refused")) == "NEAR(HAND, BLUE)"  # was unbound


@pytest.mark.parametrize(
    ("config", "wrong"),
    [
        (SimConfig, {"eval_condition": "none", "eval_every_episodes": 1}),
        (SimConfig, {"blocks": 5}),
        (AgentConfig, {"learning": True, "weights": "random"}),
        (AgentConfig, {"weights": "checkpoint"}),
        (LearnerNodeConfig, {"resume": True}),
    ],
)
def test_parameters_that_do_not_fit_together_are_rejected(config, wrong):
    with pytest.raises(ConfigError):
        config(**wrong)


def test_a_reset_to_an_episode_number_beyond_the_last_is_rejected():
    session = Session(SimConfig(episode_steps=2), "x")
    session.begin()
    with pytest.raises(ArenaError, match=f"up to {2**62}, got {2**62 + 1}"):
        session.begin(ResetRequest(2**62 + 1))
    session.begin(ResetRequest(2**62))
    assert run_episodes(session, 3)[-1][1] == 2**62 + 3


def answer_to(session: Session, share: float = 0.5, **fields: Any) -> Command:
    """A command of a share of the first joint's speed, to the step that stands."""
    stands = session.current.observation
    action = np.array([share, 0, 0, 0, 0, 0], np.float32)
    where = stands.episode, stands.step, stands.stamp_ns
    return replace(Command(*where, "me", 0, action, 3, 7), **fields)


def test_a_command_is_a_share_of_the_speed_limits_and_counted():
    session = Session(SimConfig(), "x")
    session.begin()
    frame = session.apply(answer_to(session, 0.5))
    limit = session.speed_limits[0]
    assert frame.observation.joint_velocity[0] == pytest.approx(0.5 * limit, rel=0.05)
    assert (session.steps, session.clamped) == (1, 0)
    assert frame.executed == Executed(CommandKey("me", 3, 7), answer_to(session, 0.5).action)
    frame = session.apply(answer_to(session, -1.5))
    assert frame.observation.joint_velocity[0] == pytest.approx(-limit, rel=0.05)
    assert (session.steps, session.clamped, frame.executed) == (2, 1, None)


@pytest.mark.parametrize("wrong", [{"episode": 1}, {"step": 1}, {"stamp_ns": 1}])
def test_in_lockstep_a_command_must_answer_the_current_step(wrong):
    session = Session(SimConfig(), "x")
    session.begin()
    check_answer(session, answer_to(session))
    with pytest.raises(SimError, match="expected \\(episode"):
        check_answer(session, answer_to(session, **wrong))
    without = Session(SimConfig(program_source="topic"), "x")
    without.begin()
    with pytest.raises(SimError, match="program first"):
        check_answer(without, answer_to(without))


def test_a_step_is_judged_under_its_own_program():
    asked, later = Session(SimConfig(), "x"), Session(SimConfig(), "x")
    verdict, frame = asked.begin().verdict, later.begin()
    named = later.task.verifier.targets
    blocks = later.task.episode.blocks
    for number, word in enumerate({word for block in blocks for word in block.kind.words}):
        later.submit(ProgramRequest(f"mine-{number}", f"NEAR(HAND, {word})"))
        if later.task.verifier.targets != named:
            break  # by now another block is named
    assert later.task.verifier.targets != named
    assert frame.verdict == verdict and later.current is frame


def test_the_reward_of_a_reset_is_not_counted(monkeypatch):
    session = Session(SimConfig(episode_steps=3), "x")
    session.begin()
    advance = session.task.advance

    def rewarded(velocity):
        observation, verdict = advance(velocity)
        return observation, replace(verdict, reward=1.0)

    monkeypatch.setattr(session.task, "advance", rewarded)
    for _ in range(3):
        step(session)
    assert list(session.rewards[False]) == [1.0]  # four rewards, one of them a reset's -1: 0.5


def test_mean_rewards_are_of_the_newest_20_episodes_of_a_kind(monkeypatch):
    session = Session(SimConfig(episode_steps=1, eval_every_episodes=2), "x")
    session.begin()
    advance = session.task.advance

    def numbered(velocity):
        observation, verdict = advance(velocity)
        kind = 1000.0 if session.current.evaluation else 0.0
        return observation, replace(verdict, reward=kind + observation.episode)

    monkeypatch.setattr(session.task, "advance", numbered)
    for _ in range(3 * 25):
        step(session)
    assert list(session.rewards[False]) == [float(number) for number in range(30, 50)]
    assert list(session.rewards[True]) == [1000.0 + number for number in range(5, 25)]
