"""Designs whose programs move blocks: episodes, places, the hand's controller and the pusher."""

from __future__ import annotations

import inspect
import json
from collections import Counter
from collections.abc import Callable
from itertools import combinations, product
from math import hypot
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

import pa_ros
from pa_ros import make_arena
from pa_ros.arena import (
    Design,
    Episode,
    ReachTask,
    condition_named,
    conditions_for,
    design_named,
    generate,
    preset_named,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.arena.config import ArenaChoice
from pa_ros.arena.kinematics import hand_controller, joints_at
from pa_ros.arena.rearranging import bodies, rearrange
from pa_ros.arena.render import top_view
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.language import parse, roles
from pa_ros.world.world import World
from sim_node.config import SimConfig

CONFIG, PUSH_2 = preset_named("push"), design_named("push-2")
NAMES = ("push-2", "push-3D")
SIDES = ("NEAR", "LEFT_OF", "BEHIND")


def design_of(name: str) -> Design:
    """A design by name; `push-2 sides` is push-2 with other relations, too."""
    design = design_named(name.split()[0])
    return design.with_relations(*SIDES) if name.endswith("sides") else design


def draw(name: str, condition: str, index: int) -> Episode:
    design = design_of(name)
    return generate(CONFIG, design, condition_named(condition, design), 3, index)


def apart(a: np.ndarray, b: np.ndarray) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])


@pytest.mark.parametrize("name", [*NAMES, "push-2 sides"])
def test_the_program_names_what_moves_and_where_to(name: str) -> None:
    design = design_of(name)
    task = ReachTask(CONFIG, design, seed=3)
    assert ("pairs-near" in conditions_for(design)) == name.endswith("sides")
    for condition, index in product(conditions_for(design), range(6)):
        chosen = condition_named(condition, design)
        episode = draw(name, condition, index)
        kinds = [block.kind for block in episode.blocks]
        assert len(set(kinds)) == len(kinds)
        assert episode.program == parse(str(episode.program), design.vocabulary)
        words = [set(), *(kind.words for kind in kinds)]
        moved, target = roles(episode.program, words, 0, ("PLACE",))
        assert sum(moved) == 1 + ("moved" in chosen.either)
        assert sum(target) == 1 + ("target" in chosen.either)
        assert moved[0] == (not chosen.moved)
        solid = [design.schema.has_body(kind) for kind in kinds]
        if condition.startswith("blocks-"):
            assert sum(solid) == int(condition.removeprefix("blocks-"))
        for (a, one), (b, other) in combinations(zip(episode.blocks, solid, strict=True), 2):
            least = 0.20 if one and other else 0.12 if one or other else 0.16
            assert hypot(a.x - b.x, a.y - b.y) >= least - 1e-9
        _, verdict = task.reset_to(episode)
        assert not verdict.satisfied or episode.program.moves_hand


@pytest.mark.parametrize(
    ("name", "counts"), [("push-2", (3, 4)), ("push-3D", (3, 4, 5, 6)), ("stack-2", (2, 3, 4))]
)
def test_each_number_of_blocks_that_is_scored(name: str, counts: tuple[int, ...]) -> None:
    named = [one for one in conditions_for(design_named(name)) if one.startswith("blocks-")]
    assert named == [f"blocks-{count}" for count in counts]


def test_training_programs_move_training_blocks_to_places_and_reach() -> None:
    counts = {"push-2": 3 * 2 + 3 + 2, "push-2-pairs": 3 * (2 + 2) + 3 + 2}
    for name, count in (*counts.items(), ("push-3D", 6 * 3 + 6 + 3)):
        design = design_named(name)
        programs = training_programs(design)
        assert len(programs) == count
        pushing = {program for program in programs if not program.moves_hand}
        assert {draw(name, "train", i).program for i in range(150)} == pushing
        held_out = {kind.conjunction for kind in design.held_out}
        assert not any(text in str(program) for text in held_out for program in programs)


def test_some_training_episodes_start_with_the_hand_beside_the_block() -> None:
    task, near = ReachTask(CONFIG, PUSH_2, seed=3), Counter()
    for condition in ("train", "eval"):
        for index in range(40):
            task.reset(index, condition)
            hand, block = task.simulation.positions[[0, task.verifier.moved[0]]]
            beside = hand[2] < 0.16 and 0.10 < apart(hand, block) < 0.23
            near[condition] += beside
            start = np.array(task.episode.arm_start)
            assert beside or np.allclose(start[1:], [*hand_start()][1:])
    assert 10 <= near["train"] <= 30 and near["eval"] == 0


def hand_start() -> tuple[float, ...]:
    return tuple(link.zero or 0.0 for link in hand_controller(CONFIG).joints)


def test_places_are_seen_but_not_touched_and_can_be_moved() -> None:
    task = ReachTask(CONFIG, PUSH_2, seed=3)
    task.reset(0)
    before = bodies(task)
    kinds = [block.kind for block in task.episode.blocks]
    block, place = before[1], next(i for i, k in enumerate(kinds, 1) if k["shape"] == "PLACE")
    moved = [*before[1:]]
    moved[place - 1] = type(block)(block.position, block.quaternion, *np.zeros((2, 3)))
    rearrange(task, kinds, moved)  # a place under a block
    task.step(np.zeros(6))
    after = bodies(task)
    np.testing.assert_allclose(after[1].position, before[1].position, atol=1e-4)
    np.testing.assert_allclose(after[place].position[:2], block.position[:2], atol=1e-9)
    objects = task.simulation.objects()
    assert task.world.schema.bodies(objects).tolist() == [True] * 5 + [False] * 2
    assert objects[place, 7:][PUSH_2.schema["shape"].features.values.index("PLACE")] == 1.0
    assert top_view(task, 120).shape == (120, 120, 3)
    for index in (0, place - 1):  # as films and the console do
        task.simulation.put(index, np.array([0.3, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))
    mujoco.mj_kinematics(task.simulation.model, task.simulation.data)
    np.testing.assert_allclose(task.simulation.positions[[1, place]], [[0.3, 0.0, 0.1]] * 2)
    rearrange(task, kinds[:3] + kinds[4:], [*moved[:3], *moved[4:]])
    assert len(bodies(task)) == 6


def test_the_script_moves_the_hand_to_a_block_that_is_to_be_near_it() -> None:
    task = ReachTask(CONFIG, PUSH_2, seed=5)
    task.reset(0, "eval")
    _, verdict = task.set_program(parse("NEAR(AND(RED, CUBE), HAND)", PUSH_2.vocabulary))
    assert not verdict.satisfied
    for _ in range(30):
        _, verdict = task.step(scripted_action(task))
    assert verdict.satisfied and verdict.distance == pytest.approx(0.09, abs=0.01)


@pytest.mark.parametrize("arm", ["jaco", "panda"])
def test_the_controller_knows_the_arm_and_moves_its_hand(arm: str) -> None:
    config = preset_named("push", arm)
    task = ReachTask(config, PUSH_2, seed=3)
    task.reset(0, "eval")
    controller, simulation = task.world.controller, task.simulation
    assert controller is not None
    for action in np.eye(3, dtype=np.float32) * (1.0, 1.0, -1.0):
        place, _, jacobian = controller.hand(simulation.joint_position)
        np.testing.assert_allclose(place, simulation.positions[0], atol=1e-9)
        np.testing.assert_allclose(jacobian[:3], simulation.hand_jacobian(), atol=1e-9)
        half = action.astype(np.float32) * 0.5
        command = task.world.joint_action(half, simulation.joint_position)
        assert command.shape == (config.joints,) and np.abs(command).max() <= 1.0
        for _ in range(2):
            task.step(command * np.array(config.joint_speed_limits))
        away = simulation.positions[0] - place
        radial = place[:2] / hypot(*place[:2])
        moved = away[:2] @ radial, away[1] * radial[0] - away[0] * radial[1], away[2]
        assert int(np.abs(moved).argmax()) == int(np.abs(action).argmax())
        assert np.dot(moved, action) > 0.01
    hand = controller.hand(joints_at(config, 0.3, -0.3, 0.085))
    place, axis = hand.place, hand.turn[:, 2]
    assert abs(hand.heading - controller.heading) < 0.05
    np.testing.assert_allclose(place, (0.3, -0.3, 0.085), atol=0.01)
    assert axis[2] < -0.99


@pytest.mark.parametrize("arm", ["jaco", "panda"])
def test_a_hand_that_is_drawn_in_while_it_is_low_can_go_up(arm: str) -> None:
    config = preset_named("push", arm)
    controller = world_of(config, PUSH_2).controller
    assert controller is not None
    position = np.array(joints_at(config, 0.35, 0.0, 0.16))
    speeds = np.array(config.joint_speed_limits)
    for action in (np.eye(3)[0] * -1.0, np.array([-1.0, 0.0, 1.0])):
        for _ in range(30):
            command = controller.joint_action(action.astype(np.float32), position)
            position = np.clip(position + command * speeds * config.control_period_s,
                               config.joint_lower, config.joint_upper)  # fmt: skip
    assert controller.hand(position).place[2] > 0.37


def test_a_world_with_a_controller_is_data_and_reaching_has_none() -> None:
    world = world_of(CONFIG, PUSH_2)
    assert World.from_json(world.to_json()) == world and world.actions == 3
    assert world_of(preset_named("push-joints"), PUSH_2).actions == 6
    reaching = world_of(preset_named("fast"), design_named("2-L"))
    assert "controller" not in reaching.to_json() and "moves" not in reaching.to_json()
    action = np.zeros(6, np.float32)
    assert reaching.joint_action(action, np.zeros(6)) is action


def test_the_preset_is_the_designs_own_unless_another_is_chosen() -> None:
    assert ArenaChoice(design="push-2").arena_config().preset == "push"
    assert ArenaChoice(design="push-2", preset="push-slow").arena_config().hand_speed == 0.25
    assert ArenaChoice(design="2-L").arena_config().preset == "fast"
    assert SimConfig(design="push-2").arena_config().preset == "push"
    for function in (pa_ros.train, pa_ros.make_arena):
        assert inspect.signature(function).parameters["preset"].default == ""


@pytest.mark.parametrize(
    "make",
    [
        lambda: ArenaChoice(design="push-2", preset="fast").arena_config(),
        lambda: SimConfig(design="push-2", preset="fast"),
        lambda: make_arena("push-2", preset="fast"),
        lambda: gymnasium.make("pa_ros/Reach-v0", design="push-2", preset="fast"),
        lambda: ReachTask(preset_named("fast"), PUSH_2, seed=0),
    ],
)
def test_a_preset_that_does_not_fit_is_rejected_with_those_that_fit(make: Callable[[], object]):
    fitting = r"\['paper', 'push', 'push-joints', 'push-slow', 'hold', 'hold-slow'\]"
    with pytest.raises(ConfigError, match=f"preset: expected one of {fitting} for push-2.*'fast'"):
        make()


def test_gymnasium_and_five_lines_of_python_move_blocks() -> None:
    for kind in ("flat", "structured"):
        env = gymnasium.make("pa_ros/Reach-v0", design="push-2", observation=kind).unwrapped
        observation, info = env.reset(seed=0)
        assert env.observation_space.contains(observation) and env.action_space.shape == (3,)
        observation, *_ = env.step(np.array([0.0, 0.0, -1.0], np.float32))
        assert env.observation_space.contains(observation)
        program = "NEAR(AND(RED, CUBE), AND(BLUE, CUBE))"
        _, info = env.reset(options={"program": program})
        assert info["program"] == program and info["distance"] > 0.1
    arena = make_arena("push-2", seed=1)
    assert "RED PLACE" in arena.objects and arena.task.config.preset == "push"


def test_eval_says_how_episodes_end_and_spheres_apart(tmp_path: Path) -> None:
    of = ["--design", "push-3D", "--condition", "pairs", "--episodes", "4"]
    assert main(["eval", "--policy", "scripted", *of, "--json", str(tmp_path / "eval.json")]) == 0
    report = json.loads((tmp_path / "eval.json").read_text())
    for name in ("success", "ever", "within_0.07"):
        assert 0.0 <= report[f"eval.{name}"] <= 1.0 and f"eval.spheres.{name}" in report
    assert report["eval.success"] <= report["eval.ever"] and report["eval.preset"] == "push"
