"""What a demonstration asks for, and in which scenes."""

import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named, training_programs, world_of
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.scoring.tally import EpisodeTally, HeldOutTarget, StreamedEpisode
from pa_ros.language import parse
from pa_ros.learning.checkpoints import save_checkpoint
from pa_ros.learning.learner import Learner
from pa_ros.learning.protocols import protocol_named
from pa_ros.tools.demo.scenes import (
    FARTHER,
    DemoProgram,
    demo_programs,
    draw_learning_curve,
    draw_phi,
    find_scene,
)

ARENA = preset_named("fast")
TWO_L = design_named("2-L")


@pytest.mark.parametrize("name", ["2-L", "3-D"])
def test_one_program_was_trained_and_five_were_not(name):
    design = design_named(name)
    trained = training_programs(design)
    programs = [parse(p.text, design.vocabulary) for p in demo_programs(design)]
    assert [program in trained for program in programs] == [True] + [False] * 5
    held_out = design.held_out[0]
    assert str(programs[1]) == f"NEAR(HAND, {held_out.conjunction})"


def test_for_2_l_they_are_those_of_the_issue():
    assert [(p.kind, p.text) for p in demo_programs(TWO_L)] == [
        ("trained", "NEAR(HAND, AND(RED, CUBE))"),
        ("held out", "NEAR(HAND, AND(BLUE, SPHERE))"),
        ("color alone", "NEAR(HAND, RED)"),
        ("shape alone", "NEAR(HAND, SPHERE)"),
        ("NOT", "NEAR(HAND, AND(NOT(RED), CUBE))"),
        ("OR of two", "NEAR(HAND, OR(AND(RED, CUBE), AND(BLUE, SPHERE)))"),
    ]


def test_a_design_that_holds_nothing_out_is_refused():
    with pytest.raises(ConfigError, match="2-C"):
        demo_programs(design_named("2-C"))


@pytest.mark.parametrize(
    "design",
    [TWO_L, design_named("3-D"), TWO_L.with_relations("ABOVE"), TWO_L.with_relations("BEHIND")],
    ids=lambda design: f"{design.name} {design.vocabulary.relations[0]}",
)
def test_scenes_name_the_right_number_of_blocks_out_of_reach(design):
    for program in demo_programs(design):
        scene = find_scene(ARENA, design, 5, program)
        task = ReachTask(ARENA, design, 5)
        # What sim_node's Reset service does with the scene's condition and number.
        task.reset(scene.episode.index, scene.condition)
        asked = parse(program.text, design.vocabulary)
        _, verdict = task.set_program(asked)
        assert asked.relation == design.vocabulary.relations[0]
        assert len(task.verifier.targets) == program.targets
        assert verdict.distance == scene.distance
        assert scene.distance >= FARTHER * task.scoring.threshold(asked.relation)


def test_a_program_without_a_scene_is_refused():
    with pytest.raises(ConfigError, match="names 4 block"):
        find_scene(ARENA, TWO_L, 5, DemoProgram("none", "NEAR(HAND, RED)", targets=4))


def test_pictures_are_drawn_from_a_checkpoint_and_a_tally(tmp_path):
    protocol = protocol_named("ours")
    network = protocol.network_config(world_of(ARENA, TWO_L))
    learner = Learner(network, protocol.learner, training_programs(TWO_L), 0)
    save_checkpoint(tmp_path / "checkpoint", learner)
    program = demo_programs(TWO_L)[1]
    scene = find_scene(ARENA, TWO_L, 5, program)
    draw_phi(tmp_path / "phi.png", tmp_path / "checkpoint", ARENA, TWO_L, scene, program.text)
    target = HeldOutTarget(random=-0.97, scripted=0.88)
    tally = EpisodeTally()
    tally.episodes.append(StreamedEpisode(100, False, 0.5, True))
    tally.frames = 100
    draw_learning_curve(tmp_path / "curve.png", tally, target, "one episode")
    for name in ("phi.png", "curve.png"):
        picture = (tmp_path / name).read_bytes()
        assert picture.startswith(b"\x89PNG") and len(picture) > 5000
    assert np.isfinite(scene.distance)
