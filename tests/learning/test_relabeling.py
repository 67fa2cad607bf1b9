"""Relabeling against the verifier's own definition, one transition and one program at a time."""

from collections import Counter

import numpy as np
import pytest

from helpers.worlds import UNTOLD
from pa_ros.core.errors import ConfigError
from pa_ros.language import Vocabulary, parse, satisfying
from pa_ros.learning.errors import LearningError
from pa_ros.learning.rules.all_goals import MAX_PROGRAMS, AllGoals, Masks
from pa_ros.world import Scoring
from pa_ros.world.measures import ProgramMeasures
from pa_ros.world.schema import COLORS, PAPER, SHAPES
from pa_ros.world.world import World

WORDS = Vocabulary.of(shape=(*SHAPES, "C"), color=(*COLORS, "A"))
WORLD = World(PAPER, WORDS, joints=6)
TEXTS = tuple(f"NEAR(HAND, AND({c}, {s}))" for c in COLORS[:3] for s in SHAPES[:3]) + (
    "NEAR(HAND, OR(CUBE, BLUE))",
    "NEAR(HAND, NOT(RED))",
    "NEAR(HAND, A)",
)
PROGRAMS = tuple(parse(text, WORDS) for text in TEXTS)
NEAR_M = 0.3


def relabeler() -> AllGoals:
    return AllGoals(PROGRAMS, WORLD, Scoring({"NEAR": NEAR_M}))


def episode(rng: np.random.Generator, steps: int, n: int, hand: int):
    """Ω [T + 1, N, 16] of blocks that move, and each object's true words."""
    objects = np.zeros((steps + 1, n, 16), np.float32)
    objects[..., :3] = rng.normal(0, 0.3, (steps + 1, n, 3))
    words = []
    for i in range(n):
        shape, color = rng.integers(3), rng.integers(3)
        objects[:, i, 7 + shape] = objects[:, i, 11 + color] = 1.0
        words.append({SHAPES[shape], COLORS[color]})
    objects[:, hand, :3] = objects[:, hand, 7:] = 0.0
    words[hand] = set()
    return objects, words


def test_masks_agree_with_the_verifier() -> None:
    rng = np.random.default_rng(0)
    seen = Counter()
    for trial in range(30):
        n, hand = 2 + trial % 4, trial % 2
        objects, words = episode(rng, 6, n, hand)
        satisfied, present, *_ = relabeler().masks(objects, hand)
        assert satisfied.shape == (7,)
        for j, program in enumerate(PROGRAMS):
            named = satisfying(program, words, hand)
            assert bool(present >> j & 1) == any(named)
            for t in range(7):
                away = np.linalg.norm(objects[t, list(named), :3].astype(np.float64), axis=1)
                near = away.min(initial=np.inf) <= NEAR_M
                assert bool(int(satisfied[t]) >> j & 1) == near
                seen[near] += 1
    assert min(seen.values()) > 100


def bits(rows: list[set[int]]) -> np.ndarray:
    return np.array([sum(1 << j for j in row) for row in rows], np.uint64)


@pytest.mark.parametrize("k", [2, 3, 6])
def test_draws(k) -> None:
    """Present programs only, without repetition while they last, each with its own reward."""
    rng = np.random.default_rng(1)
    present = [{0, 2, 5}, {1, 3, 4, 6, 8}, {7}, set()]
    satisfied = [{2}, {1, 8}, set(), set()]
    original = np.array([2, 1, 0, 9], np.int32)  # the third is not present
    reward = np.array([1.0, 1.0, -1.0, 1.0], np.float32)
    for _ in range(50):
        masks = Masks(bits(satisfied), bits(present))
        program, rewards = relabeler().choose(rng, original, reward, masks, k)
        assert program.shape == rewards.shape == (4, k)
        assert program.dtype == np.int32 and rewards.dtype == np.float32
        for b in range(3):
            assert set(program[b]) <= present[b]
            assert len(set(program[b])) == min(k, len(present[b]))
            times = Counter(program[b].tolist()).values()  # over again: no program is favored
            assert max(times) - min(times) <= 1
            expected = [1.0 if j in satisfied[b] else -1.0 for j in program[b]]
            np.testing.assert_array_equal(rewards[b], expected)
        assert (program[3] == 9).all() and (rewards[3] == 1.0).all()


def test_draws_are_uniform_over_what_is_present() -> None:
    rng = np.random.default_rng(2)
    size = 30_000
    masks = Masks(bits([set()] * size), bits([{0, 3, 4}] * size))
    program, _ = relabeler().choose(
        rng, np.zeros(size, np.int32), -np.ones(size, np.float32), masks, 1
    )
    counts = np.bincount(program[:, 0], minlength=5)
    assert counts[[1, 2]].sum() == 0
    np.testing.assert_allclose(counts[[0, 3, 4]] / size, 1 / 3, atol=0.015)


def test_the_64th_program_has_its_bit() -> None:
    texts = ["NEAR(HAND, " + "NOT(" * 2 * i + "RED" + ")" * 2 * i + ")" for i in range(15)]
    texts += ["NEAR(HAND, OR(" + ", ".join(["BLUE"] * i) + "))" for i in range(2, 51)]
    programs = [parse(text, WORDS) for text in texts]
    assert len(programs) == MAX_PROGRAMS
    objects, _ = episode(np.random.default_rng(0), 1, 2, 0)
    objects[:, 1, 7:] = 0.0
    objects[:, 1, [7, 13]], objects[:, 1, :3] = 1.0, 0.1  # a blue cube, near
    satisfied, present, *_ = AllGoals(programs, WORLD, Scoring({"NEAR": NEAR_M})).masks(objects, 0)
    assert present == int(satisfied[0]) == (2**64 - 2**15)
    masks = Masks(satisfied[:1], np.array([present], np.uint64))
    drawn, rewards = AllGoals(programs, WORLD, Scoring({"NEAR": NEAR_M})).choose(
        np.random.default_rng(0), np.zeros(1, np.int32), np.zeros(1, np.float32), masks, 49
    )
    assert sorted(drawn[0]) == list(range(15, 64)) and (rewards == 1.0).all()


@pytest.mark.parametrize("count", [0, MAX_PROGRAMS + 1])
def test_too_few_or_too_many_programs(count) -> None:
    with pytest.raises(ConfigError, match=f"got {count}"):
        AllGoals([PROGRAMS[0]] * count, WORLD, Scoring({"NEAR": NEAR_M}))
    assert AllGoals(PROGRAMS[:1], WORLD, Scoring({"NEAR": NEAR_M})).programs == PROGRAMS[:1]


def test_published_measures_give_the_masks_that_told_properties_give() -> None:
    rng, scoring = np.random.default_rng(0), Scoring({"NEAR": NEAR_M})
    blind = AllGoals(PROGRAMS, World(UNTOLD, WORDS, joints=6), scoring)
    measured = ProgramMeasures(PROGRAMS, WORLD, scoring)
    for trial in range(20):
        objects, words = episode(rng, 6, 5, trial % 2)
        named = measured.named(objects[0], trial % 2)
        measures = measured(named, objects, None)
        seen = objects.copy()
        seen[..., :3] += rng.normal(0, 0.002, seen[..., :3].shape)  # a camera is not exact
        seen[..., 7:] = rng.normal(size=seen[..., 7:].shape)
        told = relabeler().masks(objects, trial % 2)
        untold = blind.masks(seen, trial % 2, None, measures)
        assert (told.satisfied == untold.satisfied).all() and told.present == untold.present
        assert untold.may_name is not None
        may = untold.may_name[:, None] >> np.arange(len(PROGRAMS), dtype=np.uint64) & np.uint64(1)
        # A program that names one object is known by its measures to name it, and hardly another.
        for j in np.flatnonzero(named.sum(1) == 1):
            assert may[named[j], j] == 1 and may[:, j].sum() <= 2


@pytest.mark.parametrize("measures", [None, np.zeros((7, 3)), np.zeros((6, len(PROGRAMS)))])
def test_without_the_verifiers_measures_nothing_is_learned_of_what_is_seen(measures) -> None:
    objects, _ = episode(np.random.default_rng(0), 6, 3, 0)
    with pytest.raises(LearningError, match="expected the verifier's measures of the 12 training"):
        blind = AllGoals(PROGRAMS, World(UNTOLD, WORDS, joints=6), Scoring({"NEAR": NEAR_M}))
        blind.masks(objects, 0, None, measures)
