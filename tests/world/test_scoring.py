"""The one rule: distance, the threshold itself, and rewards, for one state and for many."""

from collections import Counter
from dataclasses import dataclass
from itertools import product
from math import inf, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32
from pa_ros.language import Program, parse, parse_goal, roles
from pa_ros.world import REWARDS, Reward, Scoring, Sparse, reward_from
from pa_ros.world.poses import objects_from_poses
from pa_ros.world.programs import ProgramTable, crisp_sets
from pa_ros.world.progress import GoalWatch
from pa_ros.world.schema import PUSHING
from pa_ros.world.scoring import REWARDED
from pa_ros.world.world import World


def scene(*positions: tuple[float, float, float]) -> Float32:
    """Ω of the hand and blocks at these places, [1 + n, 16]."""
    objects = np.zeros((1 + len(positions), 16), np.float32)
    objects[1:, :3] = positions
    return objects


NAMED = np.array([False, True, False])


@pytest.mark.parametrize(
    ("x", "satisfied"),
    [
        (0.25, True),
        (np.nextafter(np.float32(0.25), np.float32(0.0)), True),
        (np.nextafter(np.float32(0.25), np.float32(1.0)), False),
    ],
)
def test_near_includes_the_threshold(x: float, satisfied: bool) -> None:
    objects, scoring = scene((x, 0.0, 0.0), (0.0, 0.0, 0.0)), Scoring({"NEAR": 0.25})
    for score in (scoring(NAMED, objects), scoring.of_targets((1,), objects)):
        assert score.measure == float(x)
        assert (score.satisfied, score.reward) == (satisfied, 1.0 if satisfied else -1.0)


def test_the_nearest_named_object_counts() -> None:
    objects = scene((0.3, 0.4, 0.0), (0.0, 0.0, 0.1))
    named = np.array([[False, True, False], [False, True, True], [False, False, False]])
    score = Scoring({"NEAR": 0.2})(named, objects)
    np.testing.assert_allclose(score.measure, [0.5, 0.1, inf])
    assert score.satisfied.tolist() == [False, True, False]
    assert score.reward.tolist() == [-1.0, 1.0, -1.0]


@given(
    arrays(np.float32, (4, 3, 16), elements=st.floats(-2, 2, width=32)), arrays(np.bool_, (2, 3))
)
def test_many_states_and_programs_get_the_same_bits_as_each_alone(objects, named) -> None:
    """So rewards that relabeling computes equal those that the arena gave."""
    scoring = Scoring({"NEAR": 0.5})
    together = scoring(named, objects[:, None])  # [4, 2]
    for t, p in np.ndindex(4, 2):
        alone = scoring(named[p], objects[t])
        x, y, z = objects[t, :, :3].astype(float).T.tolist()
        distances = [sqrt(a * a + b * b + c * c) for a, b, c in zip(x, y, z, strict=True)]
        least = min((d for d, of in zip(distances, named[p], strict=True) if of), default=inf)
        assert alone.measure == together.measure[t, p] == least
        assert alone.satisfied == together.satisfied[t, p] == (least <= 0.5)
        assert alone.reward == together.reward[t, p]
        assert scoring.of_targets(named[p].nonzero()[0].tolist(), objects[t]) == alone


def test_a_reward_is_read_back_from_its_text() -> None:
    text = Sparse(2.0, -0.5).to_json()
    assert text == '{"name":"sparse","otherwise":-0.5,"satisfied":2.0}'
    assert reward_from(text) == Sparse(2.0, -0.5)
    assert reward_from("sparse") == Sparse() == reward_from('{"name": "sparse"}')
    assert reward_from('{"name": "sparse", "satisfied": 3}').to_json() == Sparse(3.0).to_json()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"name": "dense"}', r"unknown reward: expected one of \['sparse'.*got 'dense'"),
        ('{"name": "sparse"', "reward: expected a name, or JSON"),
        ('{"name": "sparse", "steep": 1}', r"\['satisfied', 'otherwise'\], got steep = 1"),
        ('{"name": "sparse", "satisfied": NaN}', "finite numbers .* got satisfied = nan"),
        ('{"name": "sparse", "satisfied": true}', "finite numbers .* got satisfied = True"),
        pytest.param(
            f'{{"name": "sparse", "satisfied": {10**400}}}', "reward: .* that a float", id="huge"
        ),
    ],
)
def test_a_wrong_text_is_rejected(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        reward_from(text)


@dataclass(frozen=True)
class Paying(Reward):
    def __call__(self, satisfied: Any, measure: Any) -> Any:
        return self.pays(satisfied, measure)

    @staticmethod
    def pays(satisfied: Any, measure: Any) -> Any:
        return satisfied * 1.0


@pytest.mark.parametrize(
    ("pays", "why"),
    [
        (lambda satisfied, measure: np.zeros(3), "a finite number for each state"),
        (lambda satisfied, measure: satisfied.astype(float), "numbers and arrays.*no.*'astype'"),
        (lambda satisfied, measure: np.where(satisfied, 1.0, np.nan), "number for each state.*nan"),
    ],
)
def test_a_reward_without_a_number_for_each_state_is_rejected_when_it_is_chosen(
    pays: Any, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(REWARDS, "_items", {"own": Paying})
    assert reward_from("own") == Paying()
    monkeypatch.setattr(Paying, "pays", staticmethod(pays))
    with pytest.raises(ConfigError, match=f"reward own: .*{why}"):
        reward_from("own")


def test_a_goal_is_judged_by_what_it_avoids_too() -> None:
    words, scoring = PUSHING.vocabulary.avoiding(), Scoring()
    goal = parse_goal("AVOID(BLUE, NEAR(HAND, RED))", words)
    assert isinstance(goal, Program)
    near = {goal.relation_alone: 0.15, Program(goal.avoided): 0.3}
    watch, verdicts = GoalWatch(goal), []
    for distance in (0.3, 0.1, 0.4):  # to what is to be avoided
        near[Program(goal.avoided)] = distance
        verdicts.append(watch.verdict(lambda p: scoring.of_measure(near[p]), scoring.reward))
    assert [(v.reward, v.satisfied, v.violated) for v in verdicts] == [
        (1.0, True, False), (-1.0, False, True), (-1.0, False, True)
    ]  # fmt: skip
    assert {v.distance for v in verdicts} == {0.15}


MOVING = World(PUSHING, PUSHING.vocabulary.asking("NEAR", "LEFT_OF").moving("PLACE"), joints=6)
MOVES = (
    "NEAR(RED, BLUE)",
    "NEAR(CUBE, PLACE)",
    "LEFT_OF(NOT(RED), CUBE)",
    "NEAR(HAND, PLACE)",
    "NEAR(PLACE, RED)",
    "NEAR(BLUE, HAND)",
    "NEAR(AND(RED, CUBE), AND(RED, CUBE))",
)


def test_many_states_of_moved_objects_are_scored_as_one_pair_at_a_time() -> None:
    """Some object of the first set, and another one of the second."""
    rng, seen = np.random.default_rng(1), Counter()
    assert World.from_json(MOVING.to_json()) == MOVING
    scoring = Scoring.of(MOVING.relations)
    programs = [parse(text, MOVING.vocabulary) for text in MOVES]
    table = ProgramTable(MOVING.vocabulary)
    for program in programs:
        table.add(program)
    labels = [dict(shape=s, color=c) for s in ("CUBE", "PLACE") for c in ("RED", "BLUE")]
    for _ in range(20):
        chosen = [labels[i] for i in rng.integers(4, size=4)]
        words = [set(), *(set(one.values()) for one in chosen)]
        poses = np.zeros((3, 5, 7))
        poses[..., :3], poses[..., 3:] = rng.normal(0, 0.1, (3, 5, 3)), (0.0, 0.6, 0.0, 0.8)
        objects = np.stack([objects_from_poses(PUSHING, chosen, one) for one in poses])
        hand = poses[:, 0].astype(np.float32)
        truth = MOVING.truth(objects[0]).T
        code = crisp_sets(table.compiled(), truth, 0)
        sets = np.stack([code.moved, code.target], 1)  # [P, 2, N]
        assert MOVING.schema.bodies(objects[0]).tolist() == ["PLACE" not in w for w in words]
        for j, program in enumerate(programs):
            moved, named = roles(program, words, 0, {"PLACE"})
            both = product(range(5), range(5))
            pairs = [(a, b) for a, b in both if a != b and moved[a] and named[b]]
            of = None if program.moves_hand else sets[j, 0]
            many = scoring(sets[j, 1], objects, program.relation, hand, of)
            for t in range(3):
                who, where = (np.flatnonzero(one).tolist() for one in (moved, named))
                of = None if program.moves_hand else who
                score = scoring.of_targets(where, objects[t], program.relation, hand[t], of)
                assert many.measure[t] == score.measure and many.reward[t] == score.reward
                near = [np.linalg.norm(poses[t, a, :3] - poses[t, b, :3]) for a, b in pairs]
                if program.relation == "NEAR":
                    assert score.measure == pytest.approx(min(near, default=np.inf), abs=1e-5)
                    limit = 0.2 if program.moves_hand else 0.1
                    assert score.satisfied == (score.measure <= limit)
                    rewarded = limit if program.moves_hand else REWARDED * limit
                    assert score.reward == (1.0 if score.measure <= rewarded else -1.0)
                seen[program.relation, bool(score.satisfied)] += 1
    assert len(seen) == 4 and min(seen.values()) >= 5
