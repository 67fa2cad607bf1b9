"""Zones: scenes as conditions say, a quarter of the pairs held out, a straight line beside."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import (
    ArenaChoice,
    ReachTask,
    design_named,
    generate,
    play,
    preset_for,
    preset_named,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.arena.conditions import condition_named
from pa_ros.arena.config import PRESET_VALUES
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.gym_env import ReachEnv
from pa_ros.arena.zones import APART_M, FORMULAS, HIGH_M, LOW_M, RADIUS_M, FormulaEpisode, held_out
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.traces import traces
from pa_ros.language import Program, stages
from pa_ros.world.world import World

DESIGN = design_named("zones-8")
CONFIG = preset_for(DESIGN)


def drawn(condition: str, count: int, design: str = "zones-8") -> list[FormulaEpisode]:
    one = design_named(design)
    made = (generate(CONFIG, one, condition_named(condition, one), 3, i) for i in range(count))
    return [episode for episode in made if isinstance(episode, FormulaEpisode)]


def places(episode: FormulaEpisode) -> dict[str, np.ndarray]:
    height = episode.blocks[0].look.rest_height
    return {str(b.kind): np.array([b.x, b.y, height + b.above_m]) for b in episode.blocks}


def pair_of(program: Program) -> tuple[int, int]:
    words = DESIGN.vocabulary.words
    assert program.avoided is not None
    return words.index(str(program.target)), words.index(str(program.avoided))


def test_zones_are_in_their_box_apart_from_each_other_and_from_the_hand() -> None:
    task = ReachTask(CONFIG, design_named("zones-16"), seed=0)
    for index in range(5):
        observation, _ = task.reset(index, "reach")
        centers = task.simulation.positions[1:]
        assert (centers >= LOW_M + RADIUS_M - 1e-9).all(), centers
        assert (centers <= HIGH_M - RADIUS_M + 1e-9).all(), centers
        between = np.linalg.norm(centers[:, None] - centers, axis=-1)
        assert between[~np.eye(16, dtype=bool)].min() >= APART_M - 1e-9
        assert np.linalg.norm(observation.objects[1:, :3], axis=-1).min() >= APART_M - 1e-3
        assert not task.simulation.model.nv > CONFIG.joints  # nothing to touch


def test_a_quarter_of_the_pairs_is_in_no_training_program_or_episode() -> None:
    held = held_out(8)
    assert held.sum() == 14 and not held.diagonal().any()
    programs = training_programs(DESIGN)
    others = np.argwhere(~held & ~np.eye(8, dtype=bool)).tolist()
    assert {pair_of(p) for p in programs if p.avoided is not None} == {*map(tuple, others)}
    avoided = 0
    for episode in drawn("train", 60):
        target = DESIGN.vocabulary.words.index(str(episode.program.target))
        if episode.program.avoided is not None:
            for word in Program(episode.program.avoided).words:
                avoided += 1
                assert not held[target, DESIGN.vocabulary.words.index(word)]
    assert avoided > 30
    assert all(held[pair_of(episode.program)] for episode in drawn("eval", 20))


def test_the_straight_way_of_a_blocked_scene_leads_through_a_zone_to_avoid() -> None:
    task = ReachTask(CONFIG, DESIGN, seed=3)
    for condition, new in (("blocked", False), ("blocked-pairs", True)):
        for episode in drawn(condition, 5):
            assert held_out(8)[pair_of(episode.program)] == new
            task.reset_to(episode)
            where, hand = places(episode), task.simulation.positions[0]
            to, out = (where[str(e)] for e in (episode.program.target, episode.program.avoided))
            way = hand + np.linspace(0, 1, 400)[:, None] * (to - hand)
            assert np.linalg.norm(way - out, axis=-1).min() < RADIUS_M


def test_every_formula_is_drawn_for_any_zones() -> None:
    episodes = drawn("formulas", 14, "zones-16")
    assert len({len(stages(one.goal)) for one in episodes}) > 1
    for one, formula in zip(episodes, 2 * FORMULAS, strict=True):
        assert re.sub(r"[A-Z]{3,}", "", one.formula) == re.sub(r"[A-Z]{3,}", "", formula)
    assert len({word for one in episodes for p in stages(one.goal) for word in p.words}) > 10
    assert all("!" in one.formula for one in drawn("formulas-blocked", 6))


def test_the_straight_line_reaches_zones_and_ignores_what_is_to_be_avoided() -> None:
    task = ReachTask(CONFIG, DESIGN, seed=1)
    free, blocked = (traces(task, "scripted", name, 6) for name in ("reach", "blocked"))
    assert (free.success_rate, free.violations) == (1.0, 0.0)
    assert blocked.success_rate == blocked.straight_line_rate <= 1 / 3 < blocked.violations
    assert traces(task, "random", "reach", 3).success_rate < 1.0


def test_the_straight_line_is_straight() -> None:
    task = ReachTask(CONFIG, DESIGN, seed=1)
    for index in range(8):
        start, task.simulation.way = task.reset(index, "reach"), []
        for _, verdict in play(task, lambda _: scripted_action(task), start):
            if verdict.satisfied:
                break
        way = np.array(task.simulation.way)
        task.simulation.way = None
        first, along = way[0], (way[-1] - way[0]) / np.linalg.norm(way[-1] - way[0])
        beside = way - first - ((way - first) @ along)[:, None] * along
        assert np.linalg.norm(beside, axis=1).max() < 0.01


def test_a_way_has_the_hand_after_each_physics_step_and_changes_nothing() -> None:
    plain, watched = (ReachTask(CONFIG, DESIGN, seed=1) for _ in range(2))
    for task in (plain, watched):
        task.reset(0, "reach")
    watched.simulation.way = []
    for _ in range(3):
        command = scripted_action(plain)
        (a, _), (b, _) = plain.step(command), watched.step(command)
        assert a.objects.tobytes() == b.objects.tobytes()
    assert len(watched.simulation.way) == 3 * CONFIG.substeps
    assert (watched.simulation.way[-1] == plain.simulation.positions[0]).all()


def test_the_world_says_where_near_begins_and_where_the_hand_may_be() -> None:
    world = world_of(CONFIG, DESIGN)
    assert World.from_json(world.to_json()) == world and world.scoring.thresholds["NEAR"] == 0.07
    assert world.controller is not None and world.controller.radii == (0.25, 0.83)
    usual = world_of(preset_named("push"), design_named("push-2")).to_data()
    assert "thresholds" not in usual and "radii" not in usual["controller"]


def test_a_preset_and_an_arm_are_the_designs_own_unless_others_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # What is registered here is not known to other tests.
    known = {name: PRESET_VALUES[name] for name in PRESET_VALUES}
    monkeypatch.setattr(PRESET_VALUES, "_items", known)
    assert (CONFIG.preset, CONFIG.arm) == ("zones", "panda-wide")
    for arm in ("panda", "jaco"):  # the jaco is the arm of most presets
        with pytest.raises(ConfigError, match=f"expected a preset of .* of {arm}, got 'zones'"):
            ArenaChoice(design="zones-8", arm=arm).arena_config()
    assert ArenaChoice(design="zones-8", arm="panda-wide").arena_config() == CONFIG
    assert ReachEnv(design="zones-8", observation="structured").config == CONFIG  # Gymnasium's
    PRESET_VALUES.register("test-slow", ("fast", {"hand_speed": 0.1, "thresholds": (0.1,)}))
    assert ArenaChoice(design="2-L", preset="test-slow").arena_config().hand_speed == 0.1
    with pytest.raises(ConfigError, match="unknown preset"):
        PRESET_VALUES["zone"]


def test_zones_that_do_not_fit_into_the_box_are_one_error() -> None:
    crowd, reach = replace(DESIGN, name="crowd"), condition_named("reach", DESIGN)
    object.__setattr__(crowd, "n_blocks", 70)
    with pytest.raises(ArenaError, match="70 zones, 0.14 m apart .* don't fit into the box"):
        crowd.skill.draw(CONFIG, crowd, reach, 0, np.random.default_rng(0))


def test_of_two_zones_equally_far_one_is_better_and_the_goal_does_not_say_which() -> None:
    task = ReachTask(CONFIG, DESIGN, seed=3)
    nearer = []
    for episode in drawn("non-myopic", 8):
        task.reset_to(episode)
        worse, better, last = re.findall(r"[A-Z]{2,}", episode.formula)
        assert episode.formula == f"!{worse} U ({better} & F {last})"
        either, then = (set(stage.words) for stage in stages(episode.goal))
        assert either == {better, worse} and then == {last}
        where, hand = places(episode), task.simulation.positions[0]
        first, second = (np.linalg.norm(where[one] - hand) for one in (better, worse))
        beyond = [np.linalg.norm(where[last] - where[one]) for one in (better, worse)]
        assert abs(first - second) < 0.02 and second + beyond[1] > 1.5 * (first + beyond[0])
        nearer.append(first < second)
    assert 0 < sum(nearer) < 8
