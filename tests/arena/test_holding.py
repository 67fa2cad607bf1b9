"""A hand that holds: the vacuum cup, blocks on each other, the script, and what programs mean."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import (
    ARMS,
    Block,
    Episode,
    ReachTask,
    design_named,
    play,
    preset_for,
    preset_named,
    scripted_action,
    world_of,
)
from pa_ros.arena.config import ArenaConfig
from pa_ros.core.errors import ConfigError
from pa_ros.language import ProgramError, parse, parse_goal, stages
from pa_ros.language.evaluate import role_relevance
from pa_ros.language.flat import NOT, compile_program
from pa_ros.world.relation import BLOCK_M, GRIP_M

STACK = design_named("stack-2")
RED_CUBE, BLUE_CUBE = (
    next(k for k in STACK.pool if k.words == {c, "CUBE"}) for c in ("RED", "BLUE")
)
ON = "ON(AND(RED, CUBE), AND(BLUE, CUBE))"
LET_GO, TAKE = -1.0, 1.0


@pytest.fixture(params=["jaco", "panda"])
def task(request: pytest.FixtureRequest) -> ReachTask:
    return ReachTask(preset_for(STACK, arm=request.param), STACK, seed=1)


def start(task: ReachTask, *blocks: Block, program: str = ON, held: int | None = None) -> None:
    arm = tuple(joint.start for joint in ARMS[task.config.arm].joints)
    goal = parse_goal(program, STACK.vocabulary)
    task.reset_to(Episode(0, "train", blocks, arm, goal, held))


def command(task: ReachTask, grip: float) -> np.ndarray:
    return np.array([*[0.0] * task.config.joints, grip])


def grip_of(task: ReachTask) -> np.ndarray:
    """Where the middle of a held block is, seen from the hand: straight below it."""
    x, y, z, *_ = task.simulation.hand_pose
    return np.array([x, y, z - GRIP_M])


def under_the_hand(task: ReachTask, beside_m: float = 0.0, below_m: float = 0.0) -> bool:
    """Whether the cup takes a block so far from its tip."""
    start(task, Block(RED_CUBE, 0.3, 0.3, 0.0), Block(BLUE_CUBE, -0.3, 0.3, 0.0))
    x, y, z = grip_of(task)
    start(
        task,
        Block(RED_CUBE, x + beside_m, y, 0.0, above_m=z - BLOCK_M / 2 - below_m),
        Block(BLUE_CUBE, -0.3, 0.3, 0.0),
    )
    task.simulation.cup.take()
    return bool(task.simulation.hand_pose[-1])


def test_the_cup_takes_a_block_whose_top_is_at_its_tip(task: ReachTask) -> None:
    assert under_the_hand(task)
    assert under_the_hand(task, beside_m=0.028) and not under_the_hand(task, beside_m=0.033)
    assert under_the_hand(task, below_m=0.018) and not under_the_hand(task, below_m=0.022)


def test_a_held_block_moves_with_the_hand_until_the_cup_is_off(task: ReachTask) -> None:
    start(task, Block(RED_CUBE, 0.3, 0.3, 0.0), Block(BLUE_CUBE, -0.3, 0.3, 0.0), held=0)
    turning = command(task, TAKE)
    turning[0] = 1.0
    for _ in range(10):
        observation, _ = task.step(turning)
    assert observation.hand_pose[-1] == 1.0
    np.testing.assert_allclose(task.simulation.positions[1], grip_of(task), atol=0.01)
    for _ in range(10):
        observation, _ = task.step(command(task, LET_GO))
    assert observation.hand_pose[-1] == 0.0
    assert task.simulation.positions[1][2] == pytest.approx(BLOCK_M / 2, abs=1e-3)


def test_the_slow_arm_moves_as_far_in_a_step_and_its_script_builds() -> None:
    fast, slow = preset_named("hold"), preset_named("hold-slow")
    assert slow.hand_speed < fast.hand_speed
    assert slow.hand_speed * slow.control_period_s == fast.hand_speed * fast.control_period_s
    task = ReachTask(slow, STACK, seed=0)
    *_, (_, verdict) = play(task, lambda _: scripted_action(task), task.reset(0, "eval"))
    assert verdict.satisfied


def test_the_command_that_stops_the_arm_keeps_what_it_holds(task: ReachTask) -> None:
    start(task, Block(RED_CUBE, 0.3, 0.3, 0.0), Block(BLUE_CUBE, -0.3, 0.3, 0.0), held=0)
    observation, _ = task.step(command(task, TAKE))
    for _ in range(5):
        observation, _ = task.step(observation.hold)
    assert observation.hold.tolist() == [0.0] * task.config.joints + [1.0]
    observation, _ = task.step(command(task, LET_GO))
    assert observation.hold.tolist() == [0.0] * (task.config.joints + 1)


def test_a_copy_of_the_task_holds_the_same_block(task: ReachTask) -> None:
    start(task, Block(RED_CUBE, 0.3, 0.3, 0.0), Block(BLUE_CUBE, -0.3, 0.3, 0.0), held=0)
    other = copy.deepcopy(task)
    task.step(command(task, LET_GO))
    for _ in range(5):
        observation, _ = other.step(command(task, TAKE))
    assert observation.hand_pose[-1] == 1.0 and other.simulation.positions[1][2] > 0.1


def test_a_tower_of_four_stands_for_a_minute_without_creeping() -> None:
    task = ReachTask(preset_for(STACK), STACK, seed=1)
    blocks = [
        Block(kind, 0.4 + 0.01 * (i % 2), 0.2, 0.3 * i, above_m=BLOCK_M * i)
        for i, kind in enumerate(STACK.pool)
    ]
    start(task, *blocks)
    task.simulation.data.qvel[6:] = 1e-3  # awake
    before = task.simulation.positions
    for _ in range(600):
        task.simulation.advance(command(task, LET_GO))
    assert np.abs(task.simulation.positions - before).max() < 5e-4


@pytest.mark.parametrize(
    "condition",
    [
        "train",
        "eval",
        "pairs",
        "place",
        "blocks-2",
        "hold",
        "reach",
        "tower-3",
        "tower-4",
        "rebuild-3",
        "sort-3",
    ],
)
def test_the_script_takes_puts_and_builds(condition: str) -> None:
    task = ReachTask(preset_for(STACK), STACK, seed=1)
    for index in range(4):
        *_, (_, verdict) = play(task, lambda _: scripted_action(task), task.reset(index, condition))
        assert verdict.satisfied
        assert condition != "reach" or scripted_action(task)[-1] == LET_GO


def test_a_tower_is_taken_down_and_built_in_another_order() -> None:
    task = ReachTask(preset_for(STACK), STACK, seed=1)
    task.reset(0, "rebuild-3")
    named = [" ".join(one.kind.values()) for one in task.episode.blocks[:3]]
    assert named == ["BLUE CUBE", "BLUE CYLINDER", "RED CUBE"]
    assert task.simulation.positions[1:4, 2].round(2).tolist() == [0.15, 0.03, 0.09]
    assert str(task.goal) == (
        "THEN(ON(AND(BLUE, CUBE), AND(BLUE, PLACE)), ON(AND(RED, CUBE), AND(RED, PLACE)), "
        "ALL(ON(AND(BLUE, CUBE), AND(RED, CUBE)), ON(AND(BLUE, CYLINDER), AND(BLUE, CUBE))))"
    )


def test_a_tower_is_built_from_below_whatever_the_order_of_its_text() -> None:
    top, low = "ON(AND(RED, CUBE), AND(BLUE, CUBE))", "ON(AND(BLUE, CUBE), AND(RED, CYLINDER))"
    task = ReachTask(preset_for(STACK), STACK, seed=1)
    for text, first in ((f"ALL({top}, {low})", 1), (f"ALL({low}, {top})", 0)):
        task.reset(0, "tower-4")
        _, verdict = task.set_program(parse_goal(text, STACK.vocabulary))
        assert verdict.stage == first and str(stages(task.goal)[first]) == low


def test_a_block_that_is_held_or_beside_its_support_is_not_on_it(task: ReachTask) -> None:
    red, blue = Block(RED_CUBE, 0.4, 0.2, 0.0, above_m=BLOCK_M), Block(BLUE_CUBE, 0.4, 0.2, 0.0)
    start(task, red, blue)
    assert task.step(command(task, LET_GO))[1].satisfied
    for away, holds in ((0.028, True), (0.032, False)):
        start(task, replace(red, x=0.4 + away), blue)
        assert (
            task.verifier.score(task.simulation.objects(), task.simulation.hand_pose).satisfied
            == holds
        )
    start(task, red, blue, held=0)
    x, y, z = grip_of(task)
    start(task, red, replace(blue, x=x, y=y, above_m=z - BLOCK_M * 1.5), held=0)
    assert not task.verifier.score(task.simulation.objects(), task.simulation.hand_pose).satisfied
    task.simulation.cup.switch(on=False)
    assert task.verifier.score(task.simulation.objects(), task.simulation.hand_pose).satisfied


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("ON(HAND, AND(RED, CUBE))", "program.hand"),
        ("ON(AND(RED, CUBE), HAND)", "program.hand"),
        ("HOLD(AND(RED, CUBE), AND(BLUE, CUBE))", "program.hand"),
        ("HOLD(HAND, HAND)", "program.itself"),
        ("ALL(HOLD(HAND, RED), HOLD(HAND, BLUE))", "program.hand"),
        ("HOLD(HAND, AND(RED, PLACE))", "program.needs_body"),
        ("ON(AND(RED, PLACE), AND(RED, CUBE))", "program.needs_body"),
        ("ON(AND(RED, CUBE), AND(RED, CUBE))", "program.itself"),
    ],
)
def test_what_cannot_hold_is_refused(text: str, code: str) -> None:
    task = ReachTask(preset_for(STACK), STACK, seed=1)
    task.reset(0, "place")
    with pytest.raises(ProgramError) as error:
        task.set_program(parse_goal(text, STACK.vocabulary))
    assert error.value.code == code


def test_nothing_rests_on_a_sphere() -> None:
    design = design_named("stack-3D")
    task = ReachTask(preset_for(design), design, seed=1)
    block, ball, cube = (
        next(kind for kind in design.pool if kind.words == {color, shape})
        for color, shape in (("RED", "CUBE"), ("GREEN", "SPHERE"), ("GREEN", "CUBE"))
    )
    blocks = tuple(
        Block(kind, 0.4, y, 0.0) for kind, y in ((block, 0.2), (ball, -0.2), (cube, 0.0))
    )
    arm_start = tuple(joint.start for joint in ARMS["jaco"].joints)
    on_green, on_ball = (
        parse(f"ON(RED, {target})", design.vocabulary) for target in ("GREEN", "SPHERE")
    )
    task.reset_to(Episode(0, "train", blocks, arm_start, on_green))
    assert task.verifier.targets == (3,)
    with pytest.raises(ProgramError) as error:
        task.set_program(on_ball)
    assert error.value.code == "program.needs_support"
    row = design.vocabulary.row
    ball_column = [[float(word in ball.words)] * 2 for word in row]  # the hand, and the ball
    assert role_relevance(on_green, ball_column, row, 0)[1] == [0.0, 0.0]
    assert compile_program(on_green, design.vocabulary).op.count(NOT) == 2  # places, and spheres


def test_an_arm_without_a_gripper_cannot_execute_the_programs() -> None:
    with pytest.raises(ConfigError, match=r"expected one of \['hold', 'hold-slow'\] for stack-2"):
        preset_for(STACK, "push")
    with pytest.raises(ConfigError, match="gripper: expected an arm with one that touches blocks"):
        ArenaConfig(gripper=True, arm_touches_blocks=False)
    puts = design_named("push-2").with_relations("ON")
    with pytest.raises(ConfigError, match="relation ON: expected an arm with a gripper"):
        world_of(preset_named("push"), puts)
