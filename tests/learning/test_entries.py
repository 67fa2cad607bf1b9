"""Hindsight for programs that move the hand: around entries, ended by reward and violation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from helpers.rejections import rejected
from helpers.worlds import NEAR_M, PROGRAMS, SCORING, WORLD, dpg, random_trajectory
from pa_ros.core.errors import ConfigError
from pa_ros.language import Or, Program, satisfying
from pa_ros.learning.learner import Learner
from pa_ros.learning.replay_buffer.buffer import ReplayBuffer
from pa_ros.learning.rules.entries import BEFORE, CROSS, MARGIN, Entries
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Trajectory

AVOIDING = replace(WORLD, vocabulary=WORLD.vocabulary.avoiding())
BLOCKS: list[set[str]] = [set(), {"RED", "CUBE"}, {"BLUE", "SPHERE"}]
FAR = 3 * NEAR_M


def approach(distances: Sequence[float], sequence: int = 0, other: float = FAR) -> Trajectory:
    """A trajectory in which block 1 is at these distances in the rows, and block 2 at another."""
    rng = np.random.default_rng(sequence)
    names = {"world_digest": AVOIDING.digest, "sequence": sequence}
    made = random_trajectory(rng, len(distances) - 1, **names)
    objects = made.objects.copy()
    objects[:, 1:, :3] = 0.0
    objects[:, 1, 0], objects[:, 2, 1] = distances, other
    return replace(made, objects=objects)


def rule_and_buffer(
    programs: Sequence[Program], *trajectories: Trajectory, capacity: int = 1000
) -> tuple[Entries, ReplayBuffer]:
    rule = Entries(programs, AVOIDING, SCORING, discount=0.9)
    replay = ReplayBuffer(capacity, AVOIDING, 3, rule.columns)
    for one in trajectories:
        replay.insert(one, 0, rule.describe(one))
    return rule, replay


def test_transitions_are_drawn_from_the_steps_before_another_target_was_reached() -> None:
    away = [FAR] * 100
    rule, replay = rule_and_buffer(PROGRAMS, approach(away), approach([*away, 0.01], sequence=1))
    drawn = rule.draw(np.random.default_rng(0), replay, 4000)
    around = drawn.index >= 200 - BEFORE
    assert around.mean() == pytest.approx(0.6 + 0.4 * BEFORE / 199, abs=0.04)
    reached = drawn.reward[:, 0] == 1
    assert (drawn.index[reached] == 199).all() and reached.mean() > 0.02
    assert (drawn.discount[reached] == 0).all() and (drawn.discount[drawn.index < 199] > 0).all()
    # Some of them have another target, or words would not matter.
    other = rule._target[drawn.program[around, 0]] == 1  # noqa: SLF001 - the rule's own
    assert other.mean() == pytest.approx(CROSS, abs=0.1)


def test_rewards_end_the_task_and_violations_too_with_a_margin() -> None:
    inside, outside = NEAR_M * (1 - MARGIN), NEAR_M * (1 + MARGIN)
    reach, avoid = PROGRAMS[0], replace(PROGRAMS[1], avoided=PROGRAMS[0].target)
    for distance, done, lost in (
        (inside - 1e-3, True, True), (inside + 1e-3, False, True), (outside + 1e-3, False, False)
    ):  # fmt: skip
        rule, replay = rule_and_buffer((*PROGRAMS, avoid), approach([FAR, distance]))
        drawn = rule.draw(np.random.default_rng(0), replay, 200)
        rows = zip(drawn.program[:, 0], drawn.reward[:, 0], drawn.discount, strict=True)
        for program, reward, discount in rows:
            named = rule.programs[program]
            ends = (named == reach and done) or (named == avoid and lost)
            assert reward == (named == reach and done)
            assert discount == pytest.approx(0.9 * (not ends))


def test_drawn_programs_avoid_what_training_programs_avoid_alone() -> None:
    first, second = PROGRAMS
    one_way = replace(first, avoided=second.target)
    rng = np.random.default_rng(0)
    runs = [random_trajectory(rng, world_digest=AVOIDING.digest, sequence=i) for i in range(20)]
    rule, replay = rule_and_buffer((*PROGRAMS, one_way), *runs)
    assert rule.programs == (*PROGRAMS, one_way)
    drawn = {rule.programs[row] for row in rule.draw(rng, replay, 2000).program[:, 0]}
    assert one_way in drawn and replace(second, avoided=first.target) not in drawn
    every = Entries(PROGRAMS, AVOIDING, SCORING).programs  # without avoiding ones: all pairs
    assert replace(second, avoided=first.target) in every and len(every) == 4


def test_two_sets_that_are_avoided_with_a_target_are_avoided_together() -> None:
    third = Program(PROGRAMS[0].target.operands[0])  # type: ignore[union-attr]
    pairs = [replace(PROGRAMS[0], avoided=one.target) for one in (PROGRAMS[1], third)]
    rule, _ = rule_and_buffer((*PROGRAMS, third, *pairs))
    assert replace(PROGRAMS[0], avoided=Or((PROGRAMS[1].target, third.target))) in rule.programs


def test_rows_that_a_newer_trajectory_took_are_not_drawn_for_an_older_one() -> None:
    entering = approach([*[FAR] * 20, 0.01])  # 21 rows
    newer = approach([FAR] * 15, sequence=1)
    rule, replay = rule_and_buffer(PROGRAMS, entering, newer, capacity=22)
    drawn = rule.draw(np.random.default_rng(0), replay, 500)
    assert (drawn.reward[:, 0] == 1).any()
    for index, program in zip(drawn.index, drawn.program[:, 0], strict=True):
        bodies = replay.arrays["objects"][index]
        assert satisfying(rule.programs[program], BLOCKS, 0)
        assert bodies[1, 0] in (np.float32(FAR), np.float32(0.01))


def test_a_learner_learns_by_it_and_refuses_what_cannot_be() -> None:
    settings = dpg(
        replay__batch_size=16, replay__warmup_frames=0, relabeling__rule="entries",
        updates__per_frame=1.0, engine__name="torch", action_penalty=0.01,
    )  # fmt: skip
    network = NetworkConfig(world=AVOIDING, hidden=6, attention=4)
    learner, rng = Learner(network, settings, PROGRAMS, 0, SCORING), np.random.default_rng(0)
    learner.consume(random_trajectory(rng, world_digest=AVOIDING.digest))
    assert np.isfinite([*learner.metrics().values()]).all()
    with rejected("learning.trajectory"):
        learner.rewards(np.zeros(1, np.int64), np.zeros((1, 1), np.int32))
    with pytest.raises(ConfigError, match="1 to 64 programs that avoid nothing"):
        Entries([], AVOIDING, SCORING)
