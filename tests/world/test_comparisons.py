"""Comparisons: which object of a set is meant, by its place."""

import numpy as np
import pytest

from pa_ros.acting.executing import Actor
from pa_ros.agents import load_agent
from pa_ros.arena import ReachTask, design_named
from pa_ros.arena.config import preset_named
from pa_ros.language import ProgramError, compile_program, parse, parse_goal
from pa_ros.world.comparisons import choose

DESIGN = design_named("3-D")
WORDS = DESIGN.vocabulary
IN_BASE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def scene(*places: tuple[float, float]) -> np.ndarray:
    objects = np.zeros((1 + len(places), 16), np.float32)
    objects[:, 6] = 1.0
    objects[1:, :2] = places
    return objects


@pytest.mark.parametrize(
    ("comparison", "chosen"),
    [("LEFTMOST", 3), ("RIGHTMOST", 2), ("NEAREST", 1), ("FARTHEST", 2), ("", None)],
)
def test_a_comparison_chooses_by_place(comparison: str, chosen: int | None) -> None:
    objects = scene((0.3, 0.0), (0.1, -0.5), (0.2, 0.4), (0.0, 0.9))
    among = (1, 2, 3)  # the last object is not in the set
    expected = among if chosen is None else (chosen,)
    assert choose(comparison, among, objects, IN_BASE, DESIGN.schema) == expected


def test_places_are_compared_in_the_frame_of_the_base() -> None:
    half_turn = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])  # of the hand, about z
    objects = scene((0.0, 0.4), (0.0, -0.4))
    assert choose("LEFTMOST", (1, 2), objects, half_turn, DESIGN.schema) == (2,)


def test_text_and_program() -> None:
    text = "NEAR(HAND, LEFTMOST(OR(RED, CUBE)))"
    program = parse(text, WORDS)
    assert str(program) == text and program.compares
    assert str(program.sets_alone) == "NEAR(HAND, OR(RED, CUBE))"
    goal = parse_goal(f"AVOID(BLUE, {text})", WORDS)
    assert str(goal) == f"AVOID(BLUE, {text})"


@pytest.mark.parametrize(
    ("text", "position"),
    [
        ("NEAR(HAND, AND(LEFTMOST(RED), CUBE))", 15),
        ("NEAR(HAND, LEFTMOST(RED, CUBE))", 11),
        ("NEAR(HAND, LEFTMOST(HAND))", 20),
        ("AVOID(NEAREST(RED), NEAR(HAND, BLUE))", 6),
    ],
)
def test_a_comparison_elsewhere_is_rejected(text: str, position: int) -> None:
    with pytest.raises(ProgramError) as caught:
        parse_goal(text, WORDS)
    assert caught.value.position == position


def test_sizes_are_compared_by_their_number() -> None:
    sized = design_named("sizes")
    objects = np.zeros((4, sized.schema.width), np.float32)
    objects[1:, -1] = -0.01, 0.03, 0.02
    for comparison, chosen in (("LARGEST", (3,)), ("SMALLEST", (1,))):
        assert choose(comparison, (1, 3), objects, IN_BASE, sized.schema) == chosen
    text = "NEAR(HAND, LARGEST(NOT(RED)))"
    assert str(parse(text, sized.vocabulary)) == text


def test_a_world_without_sizes_compares_none() -> None:
    with pytest.raises(ProgramError) as caught:
        parse("NEAR(HAND, LARGEST(RED))", WORDS)
    assert caught.value.code == "program.unknown_word" and caught.value.position == 11


def test_networks_are_given_no_comparison() -> None:
    with pytest.raises(ProgramError) as caught:
        compile_program(parse("NEAR(HAND, NEAREST(RED))", WORDS), WORDS)
    assert caught.value.code == "program.compares" and caught.value.position == 11


def test_verifier_and_agent_mean_the_same_object() -> None:
    task = ReachTask(preset_named("fast"), DESIGN, seed=5)
    agent = load_agent("shipped:3-D")
    actor = Actor.of(agent.snapshot)
    for index in range(8):
        observation, _ = task.reset(index, "compare")
        targets = task.verifier.targets
        assert len(targets) == 1
        score = actor.judge(observation, task.scoring)(task.program)
        assert score.measure == pytest.approx(np.linalg.norm(observation.objects[targets[0], :3]))
        # To the networks it is the only object of the set.
        p = actor.relevance(observation, task.program)
        others = actor.relevance(observation, task.program.sets_alone)
        assert p[targets[0]] == others[targets[0]] > 0.5
        assert sum(one > 0.5 for one in p) == 2 < sum(one > 0.5 for one in others)  # and the hand
