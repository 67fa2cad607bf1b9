"""Goals over time in the arena: what is pursued, the verdicts, and the chains of the conditions."""

import pytest

from helpers.rejections import rejected
from pa_ros.arena import ReachTask, conditions_for, design_named, preset_named, scripted_action
from pa_ros.language import Then, parse_goal, satisfying, stages

DESIGN = design_named("3-D")
FAST = preset_named("fast")


@pytest.fixture
def task() -> ReachTask:
    return ReachTask(FAST, DESIGN, seed=3)


@pytest.mark.parametrize("length", [2, 4, 8])
def test_a_chain_names_held_out_blocks_and_never_one_twice_in_a_row(task: ReachTask, length: int):
    for index in range(5):
        task.reset(index, f"chain-{length}")
        goal, kinds = task.goal, [block.kind for block in task.episode.blocks]
        assert isinstance(goal, Then) and len(goal.goals) == length
        words = [kind.words for kind in kinds]
        targets = []
        for program in stages(goal):
            (target,) = (
                k for k, n in zip(kinds, satisfying(program, words, None), strict=True) if n
            )
            targets.append(target)
        assert set(targets) <= set(DESIGN.held_out)
        assert all(a != b for a, b in zip(targets, targets[1:], strict=False))
        assert len(kinds) == len(set(kinds)) == DESIGN.n_blocks


def test_the_scripted_reference_executes_a_chain_stage_by_stage(task: ReachTask) -> None:
    _, verdict = task.reset(0, "chain-4")
    reached, steps = [], 0
    while not verdict.truncated:
        before, pursued = verdict.stage, task.program
        _, verdict = task.step(scripted_action(task))
        steps += 1
        if verdict.stage > before:
            reached.append(str(pursued))
        assert task.program == stages(task.goal)[verdict.stage]
        assert verdict.satisfied <= (verdict.stage == 3)
    assert verdict.satisfied and steps == 4 * FAST.episode_steps
    assert reached == [str(program) for program in stages(task.goal)[:3]]


def test_an_avoided_block_violates_the_goal_for_good(task: ReachTask) -> None:
    task.reset(0, "chain-2")
    first, second = stages(task.goal)
    goal = parse_goal(f"AVOID({first.target}, {second})", DESIGN.vocabulary)
    task.set_program(parse_goal(str(first), DESIGN.vocabulary))
    verdict = task.step(scripted_action(task))[1]
    while not verdict.satisfied:
        verdict = task.step(scripted_action(task))[1]
    _, verdict = task.set_program(goal)
    assert verdict.violated and not verdict.satisfied and verdict.reward == -1.0
    for _ in range(60):
        verdict = task.step(scripted_action(task))[1]
    assert verdict.violated and not verdict.satisfied and verdict.distance < 0.2


def test_a_goal_that_cannot_hold_here_is_rejected_and_changes_nothing(task: ReachTask) -> None:
    task.reset(0, "chain-2")
    before = task.goal
    first, second = stages(before)
    with rejected("program.names_nothing"):
        task.set_program(parse_goal(f"ALL({first}, NEAR(HAND, A))", DESIGN.vocabulary))
    with rejected("program.avoids_target"):
        task.set_program(parse_goal(f"AVOID({second.target}, {before})", DESIGN.vocabulary))
    assert task.goal == before and task.program in (first, second)


def test_a_design_with_one_held_out_block_has_no_chains() -> None:
    assert not [name for name in conditions_for(design_named("2-L")) if name.startswith("chain")]
    assert "chain-8" in conditions_for(design_named("2-C"))
