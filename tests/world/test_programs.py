"""Batched evaluation agrees with the scalar definitions."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers import programs as generated
from helpers.programs import VOCABULARY
from pa_ros.language import LOGICS, Program, parse, relevance, role_relevance, roles, satisfying
from pa_ros.language.flat import COPY, Compiled
from pa_ros.language.syntax import HAND
from pa_ros.networks.relevance import program_tensors, relevant_objects, relevant_sets
from pa_ros.world.programs import ProgramTable, crisp, crisp_sets

torch.set_num_threads(1)

WORDS = len(VOCABULARY.words)
FLOAT32 = 1e-5  # a deep program rounds once for each of its nodes


expressions = generated.expressions(max_leaves=12)
programs = st.lists(expressions.map(Program), min_size=1, max_size=6)
MOVING = VOCABULARY.moving("C")
arguments = st.one_of(expressions, st.just(HAND))
related = st.builds(lambda moved, target: Program(target, moved=moved), arguments, arguments)
moving = st.lists(
    related.filter(lambda p: not p.moves_hand or p.target != HAND), min_size=1, max_size=6
)
seeds = st.integers(0, 2**32 - 1)


def table_of(members: list[Program]) -> tuple[ProgramTable, list[int]]:
    table = ProgramTable(VOCABULARY)
    return table, [table.add(program) for program in members]


def random_phi(seed: int, *lead: int, objects: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(*lead, WORDS, objects, generator=generator)


@given(programs, seeds, st.integers(1, 6), st.sampled_from([*LOGICS.values()]), st.data())
def test_a_batch_of_different_programs_equals_each_alone(members, seed, objects, logic, data):
    hand = data.draw(st.integers(0, objects - 1))
    table, rows = table_of(members)
    code = Compiled(*(x[rows] for x in program_tensors(table)))
    phi = random_phi(seed, len(members), objects=objects)
    p = relevant_objects(phi, hand, code, logic)
    assert p.shape == (len(members), objects)
    for i, program in enumerate(members):
        expected = relevance(program, phi[i].tolist(), VOCABULARY.row, hand, logic)
        torch.testing.assert_close(p[i], torch.tensor(expected), atol=FLOAT32, rtol=0)


@given(programs, seeds)
@settings(max_examples=30)
def test_several_programs_for_each_scene_equal_one_at_a_time(members: list[Program], seed: int):
    table, rows = table_of(members)
    batch = torch.tensor([rows, rows[::-1], rows])  # [B, K]
    code = Compiled(*(x[batch] for x in program_tensors(table)))
    phi = random_phi(seed, 3, objects=5)
    p = relevant_objects(phi, 0, code)
    assert p.shape == (3, len(rows), 5)
    for k in range(len(rows)):
        one = relevant_objects(phi, 0, Compiled(*(x[:, k] for x in code)))
        torch.testing.assert_close(p[:, k], one, atol=0, rtol=0)


@given(programs, seeds, st.integers(0, 4))
def test_crisp_equals_satisfying(members: list[Program], seed: int, hand: int) -> None:
    table, rows = table_of(members)
    truth = np.random.default_rng(seed).random((WORDS, 5)) < 0.5
    named = crisp(table.compiled(), truth, hand)
    assert named.shape == (len(table), 5) and named.dtype == np.bool_
    np.testing.assert_array_equal(crisp(table.compiled(), truth.astype(float), hand), named)
    objects = [
        {w for w, holds in zip(VOCABULARY.words, column, strict=True) if holds}
        for column in truth.T
    ]
    for program, row in zip(members, rows, strict=True):
        assert tuple(named[row]) == satisfying(program, objects, hand)


@given(moving, seeds, st.integers(0, 4), st.sampled_from([*LOGICS.values()]))
@settings(max_examples=50)
def test_the_two_sets_of_a_batch_equal_each_program_alone(members, seed, hand, logic) -> None:
    table = ProgramTable(MOVING)
    rows = [table.add(program) for program in members]
    phi = random_phi(seed, len(rows), objects=5)
    code = Compiled(*(x[rows] for x in program_tensors(table)))
    registers = torch.stack([code.moved, code.target], -1)
    sets = relevant_sets(phi, hand, code, registers, logic)
    truth = phi.numpy() < 0.5
    for i, program in enumerate(members):
        of = (program, phi[i].tolist(), MOVING.row, hand, logic, MOVING.bodiless)
        expected = torch.tensor([*role_relevance(*of)])
        torch.testing.assert_close(sets[i], expected, atol=FLOAT32, rtol=0)
        objects = [{w for w in MOVING.words if column[MOVING.row[w]]} for column in truth[i].T]
        expected_sets = roles(program, objects, hand, MOVING.bodiless)
        named = crisp_sets(table.compiled(), truth[i], hand)
        np.testing.assert_array_equal(named.moved[rows[i]], expected_sets[0])
        np.testing.assert_array_equal(named.target[rows[i]], expected_sets[1])


def test_a_table_keeps_equal_programs_once_and_pads_with_copies() -> None:
    table = ProgramTable(VOCABULARY)
    assert table.compiled().op.shape == (0, 1)
    long = parse("NEAR(HAND, AND(NOT(RED), CUBE))", VOCABULARY)
    short = parse("NEAR(HAND, RED)", VOCABULARY)
    again = parse(str(short), VOCABULARY)
    assert [table.add(one) for one in (short, long, again)] == [0, 1, 0]
    assert len(table) == 2
    assert table.texts == (str(short), str(long))
    op, a, b, *others = code = table.compiled()
    assert op.shape == (2, 3) and {x.dtype for x in code} == {np.dtype(np.int32)}
    assert {x.shape for x in others} == {(2,)}
    p_of_short = WORDS + 1
    assert op[0, 1:].tolist() == [COPY, COPY]
    assert a[0, 1:].tolist() == b[0, 1:].tolist() == [p_of_short, p_of_short]
    assert table.compiled() is code
    table.add(parse("NEAR(HAND, CUBE)", VOCABULARY))
    assert table.compiled().op.shape == (3, 3)
