"""Programs that avoid a set in the arena: the conditions of designs that have them."""

from collections.abc import Sequence
from dataclasses import replace
from math import hypot

import pytest

from pa_ros.agents import load_agent
from pa_ros.arena import ReachTask, conditions_for, design_named, preset_named, scripted_action
from pa_ros.arena.avoiding import AVOID_WITHIN_M
from pa_ros.arena.episodes import Block
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.core.errors import ConfigError
from pa_ros.language import And, Not, Or, Program, ProgramError, parse, satisfying

DESIGN = design_named("3-D-avoid")


def named(program: Program, blocks: Sequence[Block]) -> list[Block]:
    words = [block.kind.words for block in blocks]
    return [b for b, n in zip(blocks, satisfying(program, words, None), strict=True) if n]


@pytest.mark.parametrize(
    ("condition", "kind", "held_out"),
    [("avoid", And, True), ("avoid-target", And, False), ("avoid-set", And, True),
     ("avoid-train", And, False), ("avoid-or", Or, None), ("avoid-not", Not, None)],
)  # fmt: skip
def test_what_is_to_be_avoided_is_near_the_target(condition, kind, held_out) -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=2)
    for index in range(10):
        task.reset(index, condition)
        blocks = task.episode.blocks
        (target,) = named(task.program, blocks)
        assert isinstance(task.program.avoided, kind)
        avoided = named(Program(task.program.avoided), blocks)
        assert target not in avoided
        assert len(avoided) == {And: 1, Or: 2, Not: 3}[kind]
        assert any(hypot(b.x - target.x, b.y - target.y) <= AVOID_WITHIN_M for b in avoided)
        if held_out is not None:
            assert (avoided[0].kind in DESIGN.held_out) == held_out


def test_what_avoids_has_one_relation_of_the_hand() -> None:
    with pytest.raises(ConfigError, match="avoids: expected the relation NEAR of the hand alone"):
        DESIGN.with_relations("NEAR", "ABOVE")


def test_half_of_the_training_episodes_avoid() -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=2)
    avoids = []
    for index in range(60):
        task.reset(index, "train")
        avoids.append(task.program.avoided is not None)
    assert 15 < sum(avoids) < 45


def test_only_designs_that_avoid_have_these_conditions() -> None:
    assert not [c for c in conditions_for(design_named("3-D")) if c.startswith("avoid")]


@pytest.mark.parametrize("condition", ["avoid", "avoid-train", "avoid-or", "avoid-not"])
def test_the_script_reaches_the_target_and_avoids_the_set(condition: str) -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=2)
    for index in range(5):
        _, verdict = task.reset(index, condition)
        while not verdict.truncated:
            _, verdict = task.step(scripted_action(task))
        assert verdict.satisfied and not verdict.violated


def two_cubes(task: ReachTask, colors: set[str]) -> None:
    """Reset the task to a scene of two cubes, exactly one of which has one of these colors."""
    for index in range(200):
        task.reset(index, "avoid")
        cubes = [b.kind["color"] for b in task.episode.blocks if b.kind["shape"] == "CUBE"]
        if len(cubes) == 2 and len(colors.intersection(cubes)) == 1:
            return
    raise AssertionError("no such scene")


def test_script_and_agent_go_for_a_target_that_need_not_be_avoided() -> None:
    task, agent = ReachTask(preset_named("fast"), DESIGN, seed=2), load_agent("shipped:avoid")
    program = parse("AVOID(GREEN, NEAR(HAND, CUBE))", DESIGN.vocabulary)
    for policy in (lambda _: scripted_action(task), lambda seen: agent.policy(seen, program)):
        two_cubes(task, {"GREEN"})
        observation, verdict = task.set_program(program)
        while not verdict.truncated:
            observation, verdict = task.step(policy(observation))
        assert verdict.satisfied and not verdict.violated


def test_a_comparison_is_made_beside_what_is_avoided() -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=2)
    two_cubes(task, {"GREEN"})
    task.set_program(parse("NEAR(HAND, LEFTMOST(CUBE))", DESIGN.vocabulary))
    (leftmost,) = task.verifier.targets
    program = parse("AVOID(NOT(CUBE), NEAR(HAND, LEFTMOST(CUBE)))", DESIGN.vocabulary)
    task.set_program(program)
    assert (task.verifier.targets, task.program) == ((leftmost,), program)


def test_a_world_says_whether_a_goal_can_hold() -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=0)
    task.reset(0, "avoid")
    objects = task.simulation.objects()
    task.world.require_possible(task.goal, objects, HAND_INDEX)
    with pytest.raises(ProgramError, match="target to be avoided"):
        itself = replace(task.program, avoided=task.program.target)
        task.world.require_possible(itself, objects, HAND_INDEX)
