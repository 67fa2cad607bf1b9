"""Relations: when each holds, where its script moves the hand, and what a relation must be."""

from dataclasses import replace
from math import nan, pi
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float64
from pa_ros.core.extensions import ExtensionError
from pa_ros.world import Scoring
from pa_ros.world.poses import IDENTITY, in_base
from pa_ros.world.relation import RELATIONS, Relation, at_stage, circle, programs_in
from pa_ros.world.relation import measured as told_measure

BLOCK = np.array([0.3, 0.3, 0.03])  # 45° to the left of the x axis, as the base sees it
OUT, LEFT = np.array([1, 1, 0]) / 2**0.5, np.array([-1, 1, 0]) / 2**0.5  # from the base; its left
UP = np.array([0.0, 0.0, 1.0])
SIDES = {"BEHIND": OUT, "IN_FRONT_OF": -OUT, "LEFT_OF": LEFT, "RIGHT_OF": -LEFT}


def measured(name: str, hand: Float64) -> float:
    return float(RELATIONS[name].of_places(hand, BLOCK[None])[0])


def holds(name: str, hand: Float64) -> bool:
    return measured(name, hand) <= RELATIONS[name].threshold


def test_near_is_the_distance() -> None:
    assert measured("NEAR", BLOCK + [0.0, 0.12, 0.16]) == pytest.approx(0.2)
    assert holds("NEAR", BLOCK + 0.19 * UP) and not holds("NEAR", BLOCK + 0.21 * UP)


def test_above_is_an_angle_from_the_vertical() -> None:
    assert measured("ABOVE", BLOCK + [0.0, 0.1, 0.1]) == pytest.approx(pi / 4)
    assert holds("ABOVE", BLOCK + 0.1 * UP) and holds("ABOVE", BLOCK + 0.6 * UP)
    assert not holds("ABOVE", BLOCK - 0.1 * UP) and not holds("ABOVE", BLOCK + 0.1 * OUT)


@pytest.mark.parametrize("name", SIDES)
def test_only_one_side_holds_as_seen_from_the_base(name: str) -> None:
    for other, way in SIDES.items():
        assert holds(name, BLOCK + 0.15 * way + 0.1 * UP) == (other == name)
    assert not holds(name, BLOCK + 0.26 * SIDES[name])  # too far
    assert measured(name, BLOCK + 0.125 * SIDES[name]) == pytest.approx(0.5)


@pytest.mark.parametrize("name", [name for name in RELATIONS if name != "HOLD"])
@given(angle=st.floats(-pi, pi), radius=st.floats(0.28, 0.58))
def test_the_relation_holds_where_the_script_goes(name: str, angle: float, radius: float) -> None:
    relation = RELATIONS[name]
    block = np.array([radius * np.cos(angle), radius * np.sin(angle), 0.03])
    goal = relation.goal(np.array([0.4, 0.0, 0.3]), block, relation.threshold)
    assert relation.of_places(goal, block[None])[0] <= 0.9 * relation.threshold
    line = relation.outline(goal, block, relation.threshold)
    assert line.ndim == 2 and line.shape[1] == 2 and np.isfinite(line).all()


@pytest.mark.parametrize(
    ("name", "way"),
    [
        ("NEAR", 0.12 * UP),
        ("ABOVE", 0.20 * UP),
        *((name, 0.14 * way + 0.12 * UP) for name, way in SIDES.items()),
    ],
)
def test_published_scores_depend_on_the_scripts_places(name: str, way: Float64) -> None:
    relation = RELATIONS[name]
    np.testing.assert_allclose(relation.goal(BLOCK, BLOCK, relation.threshold), BLOCK + way)


@pytest.mark.parametrize("name", SIDES)
def test_the_outline_of_a_side_is_where_it_begins_to_hold(name: str) -> None:
    relation = RELATIONS[name]
    start, *bow, end = relation.outline(BLOCK, BLOCK, relation.threshold)
    assert start.tolist() == end.tolist() == BLOCK[:2].tolist()
    around = [measured(name, np.array([x, y, BLOCK[2]])) for x, y in bow]
    np.testing.assert_allclose(around, relation.threshold)


def test_the_outline_of_above_is_at_the_height_of_the_hand() -> None:
    relation, hand = RELATIONS["ABOVE"], BLOCK + [0.3, 0.1, 0.2]
    line = relation.outline(hand, BLOCK, relation.threshold)
    around = [measured("ABOVE", np.array([x, y, hand[2]])) for x, y in line]
    np.testing.assert_allclose(around, relation.threshold)


POSES = arrays(np.float64, (4, 3, 7), elements=st.floats(-2, 2))


@pytest.mark.parametrize("name", [*RELATIONS])
@given(objects=POSES, hands=POSES)
def test_many_states_get_the_same_bits_as_each_alone(name: str, objects: Float64, hands: Float64):
    """The arena measures one state, relabeling many, both from float32."""
    scoring, ones = Scoring.of([name]), np.ones(3, np.bool_)
    scenes, poses = objects.astype(np.float32), hands[:, 0]
    together = scoring(ones, scenes, name, poses)
    for t in range(4):
        alone = scoring.of_targets((0, 1, 2), scenes[t], name, poses[t])
        assert alone.measure == together.measure[t] and not np.isnan(alone.measure)
        assert alone.satisfied == together.satisfied[t]


@given(arrays(np.float64, (2, 7), elements=st.floats(-1, 1)))
def test_poses_are_brought_to_the_base_as_mujoco_does(poses: Float64) -> None:
    hand, pose = poses
    expected_place, expected_turn = np.zeros(3), np.zeros(4)
    hand[3:] /= max(np.linalg.norm(hand[3:]), 1e-9)
    mujoco.mju_rotVecQuat(expected_place, pose[:3], hand[[6, 3, 4, 5]])
    mujoco.mju_mulQuat(expected_turn, hand[[6, 3, 4, 5]], pose[[6, 3, 4, 5]])
    found = in_base(hand, pose)
    if np.linalg.norm(hand[3:]) > 0.5:
        np.testing.assert_allclose(found[:3], hand[:3] + expected_place, atol=1e-12)
    np.testing.assert_allclose(found[[6, 3, 4, 5]], expected_turn, atol=1e-12)
    np.testing.assert_array_equal(in_base(IDENTITY, pose), pose)


@pytest.mark.parametrize("threshold", [0.0, nan])
def test_a_threshold_is_positive_and_finite(threshold: float) -> None:
    with pytest.raises(ConfigError, match=r"NEAR: expected a positive number \(m\), got"):
        replace(RELATIONS["NEAR"], threshold=threshold)
    with pytest.raises(ConfigError, match=str(threshold)):
        Scoring({"NEAR": threshold})


def test_scoring_rejects_unknown_relations_and_a_missing_hand_pose() -> None:
    objects = np.zeros((2, 7), np.float32)
    expected = "^unknown relation: expected one of "
    with pytest.raises(ConfigError, match=f"{expected}.*'ABOVE'.* got 'BELOW'"):
        Scoring.of(["NEAR", "BELOW"])
    with pytest.raises(ConfigError, match=rf"{expected}\['NEAR'\], got 'ABOVE'"):
        Scoring.of(["NEAR"]).of_targets((1,), objects, "ABOVE")
    with pytest.raises(ConfigError, match="relation ABOVE: expected the hand's pose"):
        Scoring.of(["ABOVE"]).of_targets((1,), objects, "ABOVE")


def far(hand: Any, objects: Any) -> Any:
    return np.sqrt(((objects - hand)[..., :3] ** 2).sum(-1))


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"measure": lambda hand, objects: far(hand, objects)[..., None]}, "measure: expected"),
        ({"goal": lambda hand, target, threshold: np.zeros(2)}, "goal: expected numbers"),
        ({"outline": lambda hand, target, threshold: np.zeros(2)}, "outline: expected .* 2"),
    ],
)
def test_a_relation_with_functions_of_the_wrong_shape_is_rejected(changed, why) -> None:
    own: dict[str, Any] = {
        "name": "OWN", "meaning": "", "measure": far, "unit": "m", "threshold": 0.1,
        "goal": lambda hand, target, threshold: target,
        "outline": lambda hand, target, threshold: circle(target, threshold),
    }  # fmt: skip
    Relation(**own)
    with pytest.raises(ConfigError, match=f"relation OWN: {why}"):
        Relation(**{**own, **changed})


@pytest.mark.parametrize("wrong", [nan, "far", np.zeros(2), [[0.0] * 3] * 2])
def test_a_measure_that_is_no_number_for_each_state_is_an_error(wrong: Any) -> None:
    def measure(hand: Float64, objects: Float64) -> Any:
        usual = far(hand, objects)
        return (
            usual if usual.max() < 2 else wrong if np.ndim(wrong) else np.full(usual.shape, wrong)
        )

    relation, objects = replace(RELATIONS["ABOVE"], name="OWN", measure=measure), np.ones((2, 3, 7))
    np.testing.assert_allclose(relation.measures(objects, IDENTITY), 3**0.5)
    with pytest.raises(ExtensionError, match="OWN: measure.*a number for each pair of poses"):
        relation.measures(2 * objects, IDENTITY)


def test_a_measure_is_told_with_its_unit_and_stage() -> None:
    goal = "THEN(NEAR(HAND, RED), ABOVE( HAND, BLUE), NEAR(RED, BLUE))"
    assert programs_in(goal) == [("NEAR", True), ("ABOVE", True), ("NEAR", False)]
    told = [told_measure(goal, 0.5, stage) for stage in range(4)]
    assert told == ["0.50 m", "0.50 rad", "0.50 m", "0.50"]
    assert (at_stage(goal, 1), at_stage("NEAR(HAND, RED)", 0)) == ("stage 2 of 3", "")
