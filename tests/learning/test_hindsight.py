"""Hindsight: places move to where a block later was, and rewards follow by the verifier's rule."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.pushing import CUBE, PLACE, PROGRAMS, PUSH, SPHERE, STEPS, TEXTS, WORDS, pushed
from helpers.worlds import dpg
from pa_ros.core.errors import ConfigError
from pa_ros.core.update import HAND_INDEX
from pa_ros.language import parse
from pa_ros.learning.config import HindsightConfig
from pa_ros.learning.learner import Learner
from pa_ros.learning.replay_buffer.buffer import ReplayBuffer
from pa_ros.learning.rules.hindsight import Hindsight, Moved
from pa_ros.learning.rules.kinds import Kinds
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.measures import ProgramMeasures
from pa_ros.world.poses import in_base
from pa_ros.world.programs import ProgramTable, crisp_sets
from pa_ros.world.schema import ObjectSchema, PropertyGroup, Seen


@pytest.fixture
def replay() -> ReplayBuffer:
    rng, rule = np.random.default_rng(0), hindsight()
    replay = ReplayBuffer(1000, PUSH, columns=rule.columns)
    for sequence in range(8):
        trajectory = pushed(rng, sequence, moves=sequence == 3)
        replay.insert(trajectory, 0, rule.describe(trajectory))
    return replay


def hindsight(in_air: bool = False, **shares: float) -> Hindsight:
    config = HindsightConfig(in_air=in_air, **({"either": 0.0} | shares))
    return Hindsight(PROGRAMS, PUSH, Scoring(), config)


def places(drawn: Moved) -> tuple[np.ndarray, np.ndarray]:
    """The place's positions in the base's frame, before and after, [B, 3] each."""
    after = position(drawn.next_arm, drawn.next_objects, PLACE)
    return position(drawn.arm, drawn.objects, PLACE), after


def position(arm: np.ndarray, objects: np.ndarray, which: int) -> np.ndarray:
    """An object's position in the base's frame, [B, 3]; the hand's pose ends the arm's features."""
    return in_base(arm[:, -7:].astype(float), objects[:, which, :7].astype(float))[:, :3]


def test_rewards_are_the_verifiers_of_the_moved_places(replay: ReplayBuffer) -> None:
    made = hindsight(either=0.5)
    drawn = made.draw(np.random.default_rng(1), replay, 500)
    assert drawn.program.shape == drawn.reward.shape == (500, 1)
    table = ProgramTable(WORDS)
    for program in made.programs:
        table.add(program)
    truth = PUSH.truth(drawn.next_objects[0]).T
    moved, named, _ = crisp_sets(table.compiled(), truth, HAND_INDEX)
    for row, program in enumerate(drawn.program[:, 0]):
        of_hand = made.programs[program].moves_hand
        score = Scoring()(named[program], drawn.next_objects[row], "NEAR",
                          moved=None if of_hand else moved[program])  # fmt: skip
        assert drawn.reward[row, 0] == score.reward
    assert set(drawn.program[:, 0]) == set(range(len(made.programs)))
    texts = set(map(str, made.programs[len(PROGRAMS) :]))
    assert {"NEAR(OR(AND(RED, SPHERE), CUBE), PLACE)", "NEAR(HAND, OR(CUBE, PLACE))"} <= texts
    assert {-1.0, 1.0} == set(drawn.reward[:, 0])


def test_kinds_of_objects_and_the_hand_are_in_the_sets_of_a_program() -> None:
    table = ProgramTable(WORDS, [parse("NEAR(HAND, PLACE)", WORDS)])
    kinds = Kinds(PUSH)
    hand = len(kinds.features) - 1  # the last kind, after those of places
    moved, target, _ = kinds.sets(table)
    assert np.flatnonzero(moved).tolist() == [hand] and target[0, hand - 1]
    assert kinds.named(table)[0, hand - 1]


def test_a_place_moves_to_where_the_moved_block_later_was(replay: ReplayBuffer) -> None:
    drawn = hindsight(moved=1, future=1, cross=0).draw(np.random.default_rng(1), replay, 300)
    about_cube = [i for i, text in enumerate(TEXTS) if "CUBE" in text]
    assert set(drawn.program[:, 0]) == set(about_cube)  # nothing else moved
    before, after = places(drawn)
    np.testing.assert_allclose(before, after, atol=1e-5)  # in the base's frame it rests
    rows = np.flatnonzero(drawn.program[:, 0] == TEXTS.index("NEAR(CUBE, PLACE)"))
    cube = position(drawn.next_arm, drawn.next_objects, CUBE)
    ahead = (before - cube)[rows]  # the cube goes along x
    assert (ahead[:, 0] > -0.15).all() and (np.abs(ahead[:, 1]) < 0.15).all()
    assert ahead[:, 0].mean() > 0.3
    made = hindsight(moved=1, future=1, cross=0, either=1)  # the sphere stays, so it is no matter
    both = [*map(str, made.programs)].index("NEAR(OR(AND(RED, SPHERE), CUBE), PLACE)")
    drawn = made.draw(np.random.default_rng(1), replay, 300)
    cube = position(drawn.next_arm, drawn.next_objects, CUBE)
    away = (places(drawn)[0] - cube)[drawn.program[:, 0] == both, 1]
    assert len(away) > 5 and (np.abs(away) < 0.15).all()


@pytest.mark.parametrize("in_air", [False, True])
def test_a_place_keeps_its_height_unless_things_may_end_in_the_air(replay, in_air: bool) -> None:
    rule = hindsight(in_air, moved=0, future=1, cross=0)
    drawn = rule.draw(np.random.default_rng(1), replay, 300)
    before, after = places(drawn)
    np.testing.assert_allclose(before, after, atol=1e-5)
    of_hand = drawn.program[:, 0] == TEXTS.index("NEAR(HAND, PLACE)")  # which goes anywhere
    assert of_hand.any() and (np.ptp(before[of_hand, 2]) > 1) == in_air


def test_a_place_may_move_to_where_another_block_was(replay: ReplayBuffer) -> None:
    drawn = hindsight(moved=1, future=1, cross=1).draw(np.random.default_rng(1), replay, 300)
    sphere = position(drawn.arm, drawn.objects, SPHERE)
    rows = np.flatnonzero(drawn.program[:, 0] == TEXTS.index("NEAR(CUBE, PLACE)"))
    assert (np.linalg.norm(places(drawn)[0] - sphere, axis=-1)[rows] < 0.15).all()


def test_programs_whose_targets_cannot_be_moved_afterwards_are_drawn_seldom(replay: ReplayBuffer):
    drawn = hindsight(moved=1).draw(np.random.default_rng(1), replay, 1000).program[:, 0].tolist()
    counts = {text: drawn.count(row) for row, text in enumerate(TEXTS)}
    assert 0 < 5 * counts["NEAR(CUBE, SPHERE)"] < counts["NEAR(CUBE, PLACE)"]


SEEN = replace(
    PUSH,
    schema=ObjectSchema(
        (
            PropertyGroup("shape", WORDS["shape"], Seen(4, told=("PLACE",)), bodiless=("PLACE",)),
            PropertyGroup("color", WORDS["color"], Seen(3, told=WORDS["color"])),
        )
    ),
)
"""As PUSH, but the words of blocks are not told."""
ONE_EACH = [
    parse(text, WORDS)
    for text in (
        "NEAR(AND(RED, CUBE), AND(RED, PLACE))", "NEAR(AND(RED, SPHERE), AND(RED, PLACE))",
        "NEAR(AND(BLUE, CUBE), AND(RED, PLACE))", "NEAR(HAND, AND(RED, CUBE))",
        "NEAR(HAND, AND(RED, PLACE))", "NEAR(AND(RED, CUBE), AND(RED, SPHERE))",
    )
]  # fmt: skip


def as_seen(trajectory: Trajectory) -> Trajectory:
    """The same in the world SEEN, with the verifier's measures."""
    measure = ProgramMeasures(ONE_EACH, PUSH, Scoring())
    named = measure.named(trajectory.objects[0], HAND_INDEX)
    measures = measure(named, trajectory.objects, trajectory.arm[:, -7:])
    objects = np.zeros((*trajectory.objects.shape[:2], SEEN.object_features), np.float32)
    objects[..., :7] = trajectory.objects[..., :7]
    objects[:, [CUBE, SPHERE], 7:] = np.random.default_rng(0).normal(size=objects.shape[2] - 7)
    objects[:, [CUBE, SPHERE], SEEN.schema.slices["shape"].stop - 1] = 0.0
    objects[:, [CUBE, SPHERE], -2:] = 0.0
    objects[:, PLACE, 7:] = SEEN.schema.features({"shape": "PLACE", "color": "RED"})[7:]
    return replace(trajectory, objects=objects, world_digest=SEEN.digest, measures=measures)


def test_hindsight_draws_the_same_where_only_the_verifier_knows_the_words_of_blocks() -> None:
    drawn, given = [], (Scoring(), HindsightConfig())
    for world in (PUSH, SEEN):
        rng, made = np.random.default_rng(0), Hindsight(ONE_EACH, world, *given)
        replay = ReplayBuffer(1000, world, columns=made.columns)
        for sequence in range(8):
            trajectory = pushed(rng, sequence, moves=sequence == 3)
            if world is SEEN:
                trajectory = as_seen(trajectory)
            replay.check(trajectory)
            replay.insert(trajectory, 0, made.describe(trajectory))
        drawn.append(made.draw(np.random.default_rng(1), replay, 500))
    told, seen = drawn
    assert set(told.program[:, 0]) >= {0, 1, 3, 4, 5}
    assert set(told.reward[:, 0]) == {-1.0, 1.0}
    for name in ("index", "program", "reward"):
        np.testing.assert_array_equal(getattr(told, name), getattr(seen, name))
    np.testing.assert_array_equal(told.next_objects[..., :7], seen.next_objects[..., :7])


def test_without_hindsight_scenes_stay_and_all_rows_are_drawn(replay: ReplayBuffer) -> None:
    drawn = hindsight(moved=0, future=0).draw(np.random.default_rng(1), replay, 300)
    np.testing.assert_array_equal(drawn.objects, replay.arrays["objects"][drawn.index])
    assert len(set(drawn.index // (STEPS + 1))) == 8


def test_a_transition_has_one_program_where_programs_move_objects() -> None:
    settings = dpg(relabeling__rule="all-goals", relabeling__programs_per_transition=2)
    with pytest.raises(
        ConfigError, match="per_transition: expected 1 where .*objects or avoid them, got 2"
    ):
        Learner(NetworkConfig(world=PUSH), settings, PROGRAMS, seed=0)


@pytest.mark.parametrize("engine", ["fused", "torch"])
def test_a_learner_learns_by_hindsight(engine: str) -> None:
    network = NetworkConfig(world=PUSH, hidden=6, attention=4, upper_layers=1)
    settings = dpg(replay__warmup_frames=0, replay__batch_size=4, relabeling__rule="all-goals",
                   relabeling__property_dropout=0.5, engine__name=engine)  # fmt: skip
    learner, rng = Learner(network, settings, PROGRAMS, seed=0), np.random.default_rng(0)
    for sequence in range(3):
        assert learner.consume(pushed(rng, sequence, moves=sequence == 1))
    assert learner.counters.updates == 3 * STEPS
    filled = learner.replay.filled()
    restored = ReplayBuffer(settings.replay.capacity_frames, PUSH, columns=learner.rule.columns)
    restored.restore(filled, learner.replay.to_metadata())
    np.testing.assert_array_equal(restored.filled()["moved"], filled["moved"])
    assert filled["moved"][STEPS + 1 : 2 * (STEPS + 1), CUBE].all()
