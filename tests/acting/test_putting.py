"""What an agent does under ON: it takes first, comes from above, and leaves what rests."""

from pathlib import Path

import numpy as np
import pytest

from pa_ros.acting.executing import Actor
from pa_ros.arena import ARMS, Block, Episode, ReachTask, design_named, preset_for
from pa_ros.core.experience import Observation
from pa_ros.evaluation.evaluate import policy_of
from pa_ros.language import parse
from pa_ros.language.syntax import NEAR
from pa_ros.learning.checkpoints import load_policy
from pa_ros.world.relation import BLOCK_M, GRIP_M

STACK = design_named("stack-2")
RED, BLUE = (next(k for k in STACK.pool if k.words == {c, "CUBE"}) for c in ("RED", "BLUE"))
ON = parse("ON(AND(RED, CUBE), AND(BLUE, CUBE))", STACK.vocabulary)
START = tuple(joint.start for joint in ARMS["jaco"].joints)


@pytest.fixture(scope="module")
def actor() -> Actor:
    return Actor.of(load_policy(Path("shipped:stack")))


@pytest.fixture
def task() -> ReachTask:
    return ReachTask(preset_for(STACK), STACK, seed=1)


def seen(task: ReachTask, red: Block, blue: Block, held: int | None = None) -> Observation:
    observation, _ = task.reset_to(Episode(0, "train", (red, blue), START, ON, held))
    return observation


def test_a_block_is_taken_before_it_is_put_somewhere(task: ReachTask, actor: Actor) -> None:
    observation = seen(task, Block(RED, 0.4, 0.2, 0.0), Block(BLUE, 0.4, -0.2, 0.0))
    taking = parse("HOLD(HAND, AND(RED, CUBE))", STACK.vocabulary)
    np.testing.assert_array_equal(actor.act(observation, ON), actor.infer(observation, taking))


def test_the_hand_slows_where_it_is_to_be(task: ReachTask, actor: Actor) -> None:
    slowed, threshold = 0, task.scoring.threshold(NEAR)
    policy = policy_of(actor, task.world, task.config)
    for episode in range(2):
        observation, verdict = task.reset(episode, "reach-eval")
        while not verdict.truncated:
            full, action = (way(observation, task.program) for way in (actor.infer, actor.act))
            part = np.clip((verdict.distance / threshold - 0.6) / 0.6, 0, 1)
            assert action[:-1] == pytest.approx(full[:-1] * part, abs=1e-3)
            assert action[-1] == full[-1], "the cup is on or off as before"
            slowed += bool(part < 1)
            observation, verdict = task.step(policy(observation, task.program))
        assert verdict.satisfied
    assert slowed > 50


def test_the_hand_rises_from_what_rests_and_holds_nothing(task: ReachTask, actor: Actor) -> None:
    on_blue = Block(RED, 0.4, 0.2, 0.0, above_m=BLOCK_M)
    action = actor.act(seen(task, on_blue, Block(BLUE, 0.4, 0.2, 0.0)), ON)
    assert action.tolist() == pytest.approx([0.0, 0.0, 0.3, -1.0])


def held_over(task: ReachTask, out: float, left: float, above: float) -> Observation:
    """A scene in which the hand holds RED so far (m, along its own axes) from resting on BLUE."""
    red, blue = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, 0.4, -0.2, 0.0)
    x, y, z, *_ = seen(task, red, blue).hand_pose
    c, s = np.array([x, y]) / np.hypot(x, y)
    height = z - GRIP_M - 1.5 * BLOCK_M - above
    under = Block(BLUE, x - c * out + s * left, y - s * out - c * left, 0.0, above_m=height)
    observation = seen(task, red, under, held=0)
    assert observation.hand_pose[-1] == 1.0
    return observation


def test_a_block_is_let_go_where_it_is_to_rest_once_the_arm_stands_still(
    task: ReachTask, actor: Actor
) -> None:
    observation = held_over(task, 0.0, 0.0, 0.0)
    assert actor.act(observation, ON).tolist() == [0.0, 0.0, 0.0, -1.0]
    observation.joint_velocity[0] = 0.5
    assert actor.act(observation, ON).tolist() == [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("way", "action"),
    [
        ((0.02, 0.0, 0.0), (-0.2, 0.0, 0.6)),  # m beside and above; 0.05 m a step at full speed
        ((0.0, -0.01, 0.015), (0.0, 0.1, 0.3)),
        ((0.0, 0.004, 0.02), (0.0, -0.04, -0.2)),
    ],
    ids=["low", "lower than it is carried", "over the middle"],
)
def test_a_block_comes_to_the_middle_before_it_is_put_down(
    way: tuple[float, float, float],
    action: tuple[float, float, float],
    task: ReachTask,
    actor: Actor,
) -> None:
    observation = held_over(task, *way)
    assert task.world.controller is not None
    assert task.world.controller.hand_speed * task.world.controller.period_s == 0.05
    done = actor.act(observation, ON).tolist()
    assert done == pytest.approx([*action, 1.0], abs=0.01)


@pytest.mark.parametrize("out", [0.05, 0.1])
def test_a_block_that_is_beside_and_low_only_rises(
    out: float, task: ReachTask, actor: Actor
) -> None:
    out, left, up, holds = actor.act(held_over(task, out, 0.0, 0.01), ON).tolist()
    assert (out, left, holds) == (0.0, 0.0, 1.0) and up >= 0.4


def test_a_block_goes_to_the_middle_from_where_networks_may_stop(
    task: ReachTask, actor: Actor
) -> None:
    action = actor.act(held_over(task, 0.055, 0.0, 0.03), ON)
    assert action[:2].tolist() == pytest.approx([-0.2, 0.0], abs=0.01)
    action = actor.act(held_over(task, 0.065, 0.0, 0.03), ON)
    assert action[:2].tolist() != pytest.approx([-0.2, 0.0], abs=0.01)


@pytest.mark.parametrize(
    ("beside", "network", "out"),
    [
        (0.11, 0.0, -0.2),
        (0.11, -0.15, -0.2),
        (0.11, -0.9, -0.9),
        (0.11, 0.5, -0.2),
        (0.3, 0.1, -0.2),
        (0.3, -0.3, -0.3),
    ],
)
def test_networks_that_stop_away_from_the_middle_are_helped(
    beside: float,
    network: float,
    out: float,
    task: ReachTask,
    actor: Actor,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = np.array([network, 0.0, 0.0, 1.0], np.float32)
    monkeypatch.setattr(actor, "infer", lambda *_: given.copy())
    action = actor.act(held_over(task, beside, 0.0, 0.03), ON)
    assert action[:2].tolist() == pytest.approx([out, 0.0], abs=0.01)


def test_another_block_in_the_hand_is_put_down_first(task: ReachTask, actor: Actor) -> None:
    """As after a new program that comes while the hand carries something."""
    program = parse("ON(AND(BLUE, CUBE), AND(RED, CUBE))", STACK.vocabulary)
    blocks = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, -0.4, -0.2, 0.0)
    policy = policy_of(actor, task.world, task.config)
    observation, verdict = task.reset_to(Episode(0, "train", blocks, START, program, held=0))
    assert actor.act(observation, program).tolist() == pytest.approx([0.0, 0.0, -0.2, 1.0])
    released = []
    while not verdict.truncated:
        before = observation
        observation, verdict = task.step(policy(before, program))
        if before.hand_pose[-1] > observation.hand_pose[-1]:
            released.append(before.hand_pose[2] - before.objects[1, 2])  # the hand points down
    assert verdict.satisfied
    assert released[0] == pytest.approx(BLOCK_M / 2, abs=0.012)  # RED, on the table


@pytest.mark.parametrize(("beside", "out"), [(0.11, 0.2), (0.13, 0.0)])
def test_the_empty_hand_is_helped_only_near_what_it_takes(
    beside: float, out: float, task: ReachTask, actor: Actor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(actor, "infer", lambda *_: np.zeros(4, np.float32))
    red, blue = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, -0.4, -0.2, 0.0)
    x, y, *_ = seen(task, red, blue).hand_pose
    r = np.hypot(x, y)
    red = Block(RED, x + x / r * beside, y + y / r * beside, 0.0)
    action = actor.act(seen(task, red, blue), ON)
    assert action[:2].tolist() == pytest.approx([out, 0.0], abs=0.01)


@pytest.mark.parametrize(("turn", "left"), [(2.5, 0.2), (-2.5, -0.2)])
def test_where_networks_stop_the_block_goes_around_the_base(
    turn: float, left: float, task: ReachTask, actor: Actor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(actor, "infer", lambda *_: np.array([0.0, 0.0, 0.0, 1.0], np.float32))
    red, blue = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, -0.4, -0.2, 0.0)
    x, y, *_ = seen(task, red, blue).hand_pose
    c, s = np.cos(turn), np.sin(turn)
    far = Block(BLUE, c * x - s * y, s * x + c * y, 0.0)
    action = actor.act(seen(task, red, far, held=0), ON)
    assert action[:2].tolist() == pytest.approx([0.0, left], abs=0.01)


@pytest.mark.parametrize(("above", "up"), [(-BLOCK_M, 1.0), (0.02, 0.2), (0.05, 0.0)])
def test_a_block_rises_over_what_is_still_far_away(
    above: float, up: float, task: ReachTask, actor: Actor, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = np.array([-0.5, 0.1, 0.0, 1.0], np.float32)
    monkeypatch.setattr(actor, "infer", lambda *_: given.copy())
    action = actor.act(held_over(task, 0.3, 0.0, above), ON)
    assert action.tolist() == pytest.approx([-0.5, 0.1, up, 1.0], abs=0.01)


def test_the_empty_hand_comes_down_over_the_middle(task: ReachTask, actor: Actor) -> None:
    red, blue = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, 0.4, -0.2, 0.0)
    x, y, z, *_ = seen(task, red, blue).hand_pose
    c, s = np.array([x, y]) / np.hypot(x, y)
    for out, up in ((0.004, -0.2), (0.02, 0.4)):  # over the middle; beside it, and 1 cm above
        height = z - GRIP_M - BLOCK_M / 2 - 0.01
        below = Block(RED, x + c * out, y + s * out, 0.0, above_m=height)
        action = actor.act(seen(task, below, blue), ON)
        assert action[:3].tolist() == pytest.approx([min(out / 0.1, 0.2), 0.0, up], abs=0.02)


@pytest.mark.parametrize(("away", "stays"), [(0.12, True), (0.2, False)])
def test_a_block_rises_before_it_passes_others(
    away: float, stays: bool, task: ReachTask, actor: Actor
) -> None:
    other = next(kind for kind in STACK.pool if kind.words == {"RED", "CYLINDER"})
    red, blue = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, -0.4, -0.2, 0.0)
    x, y, z, *_ = seen(task, red, blue).hand_pose
    beside = Block(other, x + away, y, 0.0, above_m=z - GRIP_M - 1.5 * BLOCK_M)
    start = Episode(0, "train", (red, blue, beside), START, ON, held=0)
    action = actor.act(task.reset_to(start)[0], ON)
    assert bool(action[:2].any()) is not stays
    assert not stays or action[2] > 0.5


def test_the_empty_hand_first_leaves_another_block_that_it_touches(
    task: ReachTask, actor: Actor
) -> None:
    red, blue = Block(RED, 0.4, 0.2, 0.0), Block(BLUE, 0.4, -0.2, 0.0)
    x, y, z, *_ = seen(task, red, blue).hand_pose
    at_hand = Block(BLUE, x, y, 0.0, above_m=z - GRIP_M - BLOCK_M / 2)
    action = actor.act(seen(task, red, at_hand), ON)
    assert action.tolist() == pytest.approx([0.0, 0.0, 0.3, -1.0])
