"""Transitions join consecutive steps of one episode, program and policy: by construction."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.worlds import POSE, PROGRAMS, WORLD
from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.core.experience import AgentKey, Observation, Verdict
from pa_ros.language import Program

P, Q = PROGRAMS
AGENT = (AgentKey("agent", 3), "run", 4, WORLD)


def step(episode: int, index: int, program: Program = P, truncated: bool = False):
    """An observation whose arm's first velocity tells where it came from, and its verdict."""
    stamp = 1000 * episode + index
    velocity = np.full(6, 100.0 * episode + index)
    seen = np.full((2, 16), index, np.float32), np.zeros(6), velocity, 0
    observation = Observation(episode, index, stamp, *seen, f"{episode}.{program}", POSE)
    return observation, Verdict(float(index), False, 0.0, truncated), program


def action(episode: int, index: int) -> np.ndarray:
    return np.full(6, (100 * episode + index) / 1e4, np.float32)


def feed(builder: TrajectoryBuilder, steps, version: int = 0) -> list:
    """Observe and act at each (episode, step, program, truncated)."""
    trajectories = []
    for episode, index, program, truncated in steps:
        trajectory = builder.observe(*step(episode, index, program, truncated))
        trajectories += [trajectory] if trajectory else []
        if not truncated:
            builder.acted(action(episode, index), version)
    return trajectories


def test_an_episode_in_trajectories() -> None:
    builder = TrajectoryBuilder(*AGENT)
    trajectories = feed(builder, [(7, i, P, i == 10) for i in range(11)])
    assert [len(s) for s in trajectories] == [4, 4, 2]
    assert [s.first_step for s in trajectories] == [0, 4, 8]
    assert [s.sequence for s in trajectories] == [0, 1, 2]
    assert [s.ends_episode for s in trajectories] == [False, False, True]
    assert not any(s.terminated for s in trajectories)
    assert builder.at_boundary
    rewards = np.concatenate([s.rewards for s in trajectories])
    np.testing.assert_array_equal(rewards, np.arange(1, 11))
    np.testing.assert_allclose(trajectories[1].arm[:, -1], 700 + np.arange(4, 9))
    np.testing.assert_array_equal(trajectories[1].objects[:, 0, 0], np.arange(4, 9))
    np.testing.assert_allclose(trajectories[2].actions[:, 0], [0.0708, 0.0709])


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["next"] * 8 + ["skip", "again", "episode", "program", "no action"]),
        st.booleans(),
    ),
    max_size=80,
)


@settings(deadline=None, max_examples=200)
@given(EVENTS)
def test_no_transition_joins_what_did_not_follow(events) -> None:
    """Whatever is dropped, repeated or restarted, a trajectory is one run of true transitions."""
    builder = TrajectoryBuilder(*AGENT)
    episode, index, program = 0, 0, P
    taken: set[tuple[int, int, Program]] = set()  # steps whose action was applied, by program
    true: set[tuple[int, int, Program]] = set()  # transitions that happened
    trajectories = []
    acted_at: tuple[int, int, Program] | None = None
    for event, truncated in events:
        if event == "episode":
            episode, index = episode + 1, 0
        elif event == "program":
            program = Q if program == P else P
            index += 1
        elif event != "again":
            index += 2 if event == "skip" else 1
        truncated = truncated and event == "next" and index > 8
        if acted_at == (episode, index - 1, program):
            true.add(acted_at)
        trajectory = builder.observe(*step(episode, index, program, truncated))
        trajectories += [trajectory] if trajectory else []
        acted_at = None
        if truncated:
            episode, index = episode + 1, -1
        elif event != "no action":
            builder.acted(action(episode, index), 0)
            acted_at = (episode, index, program)
    last = builder.observe(*step(episode + 1, 0))
    trajectories += [last] if last else []
    for trajectory in trajectories:
        steps = range(trajectory.first_step, trajectory.first_step + len(trajectory))
        expected = 100.0 * trajectory.episode + np.arange(steps.start, steps.stop + 1)
        np.testing.assert_array_equal(trajectory.arm[:, -1], expected)
        np.testing.assert_allclose(trajectory.actions[:, 0], expected[:-1] / 1e4, rtol=1e-6)
        np.testing.assert_array_equal(trajectory.rewards, np.array(steps) + 1)
        for at in steps:
            key = (trajectory.episode, at, trajectory.program)
            assert key in true and key not in taken
            taken.add(key)
    assert taken == true
    assert [s.sequence for s in trajectories] == list(range(len(trajectories)))


def test_where_more_objects_are_found_or_fewer_another_trajectory_begins() -> None:
    builder, found = TrajectoryBuilder(*AGENT), []
    for index, count in enumerate((2, 2, 3, 3, 2, 2)):
        observation, verdict, program = step(0, index)
        observation = replace(observation, objects=np.zeros((count, 16), np.float32))
        verdict = replace(verdict, measures=(float(index),))
        done = builder.observe(observation, verdict, program)
        found += [done] if done else []
        builder.acted(action(0, index), 0)
    shapes = [(t.first_step, *t.objects.shape[:2], t.ends_episode) for t in found]
    assert shapes == [(0, 3, 2, False), (2, 2, 3, False)]
    measures = [t.measures.ravel().tolist() for t in found if t.measures is not None]
    assert measures == [[0.0, 1.0, 2.0], [2.0, 3.0]]


@pytest.mark.parametrize("episode", [3, 9])
def test_nothing_joins_on_after_a_reset_to_a_lower_or_higher_episode(episode: int) -> None:
    """Not even where step and program go on: a program that someone sent outlives episodes."""
    builder = TrajectoryBuilder(*AGENT)
    trajectories = []
    for at, index in ((7, 0), (7, 1), (7, 2), (episode, 3), (episode, 4), (episode, 5)):
        observation, verdict, program = step(at, index)
        observation = replace(observation, program_id="mine")
        done = builder.observe(observation, verdict, program)
        trajectories += [done] if done else []
        builder.acted(action(at, index), 0)
    trajectories += [builder.observe(*step(20, 0))]
    found = [(t.episode, t.first_step, len(t), t.ends_episode) for t in trajectories]
    assert found == [(7, 0, 2, True), (episode, 3, 2, True)]
