"""Property dropout: what is hidden, of whom, and when."""

import numpy as np
import pytest

from helpers.worlds import PROGRAMS, UNTOLD, WORLD, dpg, random_trajectory
from pa_ros.core.experience import Float32
from pa_ros.core.update import Batch
from pa_ros.language import Vocabulary, parse
from pa_ros.learning.learner import Learner
from pa_ros.learning.rules.dropout import PropertyDropout
from pa_ros.learning.rules.own import OwnProgram
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.programs import ProgramTable
from pa_ros.world.schema import COLORS, PAPER, SHAPES
from pa_ros.world.world import World

ALL = Vocabulary.of(shape=SHAPES, color=COLORS)
SHAPE, COLOR = slice(7, 11), slice(11, 16)


def scene(*kinds: tuple[str, str]) -> Float32:
    """A hand and a block of each (color, shape), [N, 16]."""
    objects = np.random.default_rng(0).normal(size=(len(kinds) + 1, 16)).astype(np.float32)
    objects[:, 7:] = 0.0
    for row, (color, shape) in enumerate(kinds, start=1):
        objects[row, [7 + SHAPES.index(shape), 11 + COLORS.index(color)]] = 1.0
    return objects


BLOCKS = (("RED", "CUBE"), ("BLUE", "CUBE"), ("GREEN", "SPHERE"))


def hide(
    programs: tuple[str, ...], drawn: Float32, probability: float = 0.5, kinds=BLOCKS
) -> tuple[Float32, Float32]:
    """Objects [B, N, 16] before and after a step, of which the K programs of the scene hide."""
    table = ProgramTable(ALL)
    rows = [table.add(parse(f"NEAR(HAND, {text})", ALL)) for text in programs]
    objects = np.stack([scene(*kinds)] * len(drawn))
    following = objects + (0.5 * (np.arange(16) < 7)).astype(np.float32)
    program = np.tile(np.array(rows, np.int32), (len(drawn), 1))
    dropout = PropertyDropout(OwnProgram(0.9), table, World(PAPER, ALL, joints=6), probability)
    dropout.hide(drawn, objects, following, program)
    assert (following[..., 7:] == objects[..., 7:]).all()
    assert (following[..., :7] == objects[..., :7] + np.float32(0.5)).all()
    assert (objects[..., :7] == scene(*kinds)[..., :7]).all()
    return objects, scene(*kinds)


def draws(size: int) -> Float32:
    return np.random.default_rng(1).random((size, 2), np.float32)


@pytest.mark.parametrize(
    ("programs", "named"),
    [
        (("AND(RED, CUBE)",), {1}),
        (("AND(RED, CUBE)", "AND(GREEN, SPHERE)"), {1, 3}),
        (("CUBE",), {1, 2}),
        (("NOT(CUBE)",), {3}),
        (("OR(RED, BLUE)", "GREEN"), {1, 2, 3}),
        (("AND(RED, SPHERE)",), set()),
    ],
)
def test_only_blocks_that_no_program_names_hide_anything(programs, named) -> None:
    objects, shown = hide(programs, draws(600))
    changed = (objects != shown).any(-1)  # [B, N]
    assert set(np.flatnonzero(changed.any(0))) == {1, 2, 3} - named
    assert changed.sum(1).max() == (named != {1, 2, 3})
    assert set(np.unique(objects[..., 7:])) == {0.0, 1.0}


@pytest.mark.parametrize("probability", [0.3, 1.0])
def test_a_shape_a_color_or_both_in_equal_parts(probability) -> None:
    objects, shown = hide(("AND(RED, CUBE)",), draws(6000), probability)
    shape = (objects[..., SHAPE] != shown[..., SHAPE]).any((1, 2))
    color = (objects[..., COLOR] != shown[..., COLOR]).any((1, 2))
    for part in (shape & ~color, shape & color, color & ~shape):
        assert part.mean() == pytest.approx(probability / 3, abs=0.02)
    block = (objects != shown).any(-1)
    assert block[:, 2].mean() == pytest.approx(probability / 2, abs=0.02)


def test_new_programs_of_the_table_count_too() -> None:
    table = ProgramTable(ALL)
    rows = [table.add(parse("NEAR(HAND, AND(RED, CUBE))", ALL))]
    dropout = PropertyDropout(OwnProgram(0.9), table, World(PAPER, ALL, joints=6), 1.0)
    for text, hidden in (("AND(BLUE, CUBE)", 3), ("AND(GREEN, SPHERE)", 2)):
        objects = np.stack([scene(*BLOCKS)] * 5)
        rows[1:] = [table.add(parse(f"NEAR(HAND, {text})", ALL))]
        program = np.array([rows] * 5, np.int32)
        dropout.hide(draws(5), objects, objects.copy(), program)
        assert set(np.flatnonzero((objects != scene(*BLOCKS)).any((0, 2)))) == {hidden}


def learned(**fields: object) -> tuple[Learner, list[Batch]]:
    """A learner, and forty of its batches of four transitions."""
    config = dpg(
        replay__batch_size=4,
        replay__capacity_frames=1000,
        schedule__trajectory_steps=10,
        engine__name="torch",
        **fields,
    )
    one = Learner(NetworkConfig(world=WORLD, hidden=6, attention=4), config, PROGRAMS, seed=0)
    rng = np.random.default_rng(0)
    for sequence in range(4):
        one.consume(random_trajectory(rng, 10, sequence=sequence))
    return one, list(one.batches(40))


@pytest.mark.parametrize("relabel", ["none", "all-goals"])
def test_only_blocks_that_no_drawn_program_names_are_hidden(relabel) -> None:
    """Of two blocks, each named by one program, the other's are hidden; the replay keeps them."""
    _, plain = learned(relabeling__rule=relabel)
    assert all((batch.objects[:, 1:3, 7:].sum(-1) == 2).all() for batch in plain)
    hidden = 0
    learner, drawn = learned(relabeling__rule=relabel, relabeling__property_dropout=0.9)
    for batch in drawn:
        rows, acted = np.asarray(batch.rows), learner.replay.arrays["program"]
        rewards = learner.rewards(rows, batch.program)  # stored ones for the program that acted
        other = batch.program != acted[rows, None]
        np.testing.assert_array_equal(rewards[other], batch.reward[other])
        for b, (row,) in enumerate(batch.program):
            named, other = (1, 2) if row == 0 else (2, 1)
            assert batch.objects[b, named, 7:].sum() == 2
            hidden += batch.objects[b, other, 7:].sum() < 2
            np.testing.assert_array_equal(batch.objects[b, :, 7:], batch.next_objects[b, :, 7:])
    assert 0.8 * 160 < hidden < 160


def test_where_nothing_tells_words_objects_that_a_program_may_name_keep_their_features() -> None:
    table = ProgramTable(ALL)
    rows = [table.add(parse(f"NEAR(HAND, {word})", ALL)) for word in ("RED", "CUBE")]
    objects = np.ones((400, 4, 16), np.float32)
    may_name = np.tile(np.array([0, 0b01, 0b10, 0b11], np.uint64), (400, 1))
    program = np.full((400, 1), rows[0], np.int32)
    dropout = PropertyDropout(OwnProgram(0.9), table, World(UNTOLD, ALL, joints=6), 0.5)
    dropout.hide(draws(400), objects, objects.copy(), program, may_name)
    hidden = (objects == 0).any((0, 2))
    assert hidden.tolist() == [False, False, True, False]
    assert {(not row[7:11].any(), not row[11:].any()) for row in objects[:, 2]} == {
        (False, False), (True, False), (False, True), (True, True)
    }  # fmt: skip
