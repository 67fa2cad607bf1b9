"""The demonstration and films: their programs and scenes, what they leave, and how they end."""

import re
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import Mock

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image, ImageSequence

from helpers.pictures import opengl
from helpers.processes import processes_of
from pa_ros.acting.execution import Result
from pa_ros.agents import load_agent
from pa_ros.arena import ReachTask, design_named, preset_named, training_programs
from pa_ros.arena.skills import DemoProgram
from pa_ros.cli.demo import MOVES, execute
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.language import parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.tools.film import FARTHER, demo_programs, find_scene

graph = pytest.mark.graph
TWO_L, ARENA = design_named("2-L"), preset_named("fast")


@pytest.mark.parametrize("name", ["2-L", "3-D"])
def test_one_program_was_trained_and_five_were_not(name):
    design = design_named(name)
    trained = training_programs(design)
    programs = [parse(p.text, design.vocabulary) for p in demo_programs(design)]
    assert [program in trained for program in programs] == [True] + [False] * 5
    assert str(programs[1]) == f"NEAR(HAND, {design.held_out[0].conjunction})"


@pytest.mark.parametrize(
    "design",
    [
        TWO_L,
        design_named("3-D"),
        TWO_L.with_relations("BEHIND"),
        design_named("push-2"),
        design_named("push-3D"),
    ],
    ids=lambda design: f"{design.name} {design.vocabulary.relations[0]}",
)
def test_scenes_have_the_right_number_of_targets_out_of_reach(design):
    arena = preset_named(design.preset)
    for program in demo_programs(design):
        scene = find_scene(arena, design, 5, program)
        task = ReachTask(arena, design, 5)
        task.reset(scene.episode.index, scene.condition)
        asked = parse(program.text, design.vocabulary)
        _, verdict = task.set_program(asked)
        assert len(task.verifier.named) == program.targets
        assert verdict.distance == scene.distance
        threshold = task.scoring.threshold(asked.relation, between=not asked.moves_hand)
        assert scene.distance >= FARTHER * threshold


def test_without_a_fitting_design_or_scene_there_is_an_error():
    with pytest.raises(ConfigError, match="2-C"):
        demo_programs(design_named("2-C"))
    with pytest.raises(ConfigError, match="names 4 object"):
        find_scene(ARENA, TWO_L, 5, DemoProgram("none", "NEAR(HAND, RED)", targets=4))


@graph
@pytest.mark.parametrize(("name", "kinds"), [("3-D", ()), ("push", MOVES["push"][0])])
def test_a_shipped_agent_executes_programs_and_is_recorded(name, kinds, tmp_path, capfd):
    design = load_agent(f"shipped:{name}").design
    assert execute(tmp_path, design, f"shipped:{name}", 1_000_000, speed=5.0, kinds=kinds)
    table = capfd.readouterr().out
    programs = [one for one in demo_programs(design) if not kinds or one.kind in kinds]
    for program in programs:
        assert re.search(rf"{re.escape(program.text)} +\d\.\d\d m +\d\.\d\d m +(yes|NO)", table)
    with (tmp_path / "programs/programs.mcap").open("rb") as stream:
        rows = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/program"]
        )
        sent = {row.decoded_message.program_id: row.decoded_message.text for row in rows}
    assert list(sent.values()) == [program.text for program in programs]


def test_the_table_says_why_a_program_was_not_executed(tmp_path, monkeypatch, capsys) -> None:
    arm = Mock(execute=lambda text: Result(text, False, 0.5, None, "not within 10 s"))
    simulated = Mock(simulated=lambda *_, **__: nullcontext(arm))
    monkeypatch.setattr("pa_ros.cli.demo.Arm", simulated)
    monkeypatch.setenv("ROS_DOMAIN_ID", "1")
    assert not execute(tmp_path, TWO_L, "shipped:2-L", 0)
    table = capsys.readouterr().out
    assert table.count("0.50 m  NO         not within 10 s\n") == 6
    assert "0 of 6 programs executed" in table


@graph
def test_without_enough_time_it_says_so_and_leaves_what_was_learned(tmp_path, monkeypatch, capfd):
    folder = tmp_path / "demo"
    monkeypatch.setattr("pa_ros.cli.demo.REFERENCE_EPISODES", 2)
    options = ["--no-shipped", "--no-console", "--out", str(folder), "--minutes", "0.4"]
    assert main(["demo", *options]) == 1
    assert "target NOT reached" in capfd.readouterr().out
    assert load_policy(folder / "checkpoint").version > 0
    assert (folder / "detectors.png").exists()
    assert not processes_of(tmp_path)


def test_a_film_shows_the_goal_of_a_condition_until_it_holds(tmp_path, capsys) -> None:
    path = tmp_path / "chain.gif"
    chain = ["--condition", "chain-2", "--width", "64"]
    assert main(["film", "--checkpoint", "shipped:3-D", *chain, "--out", str(path)]) == 0
    said = capsys.readouterr().out
    assert said.endswith("not reached: none\n")
    with Image.open(path) as film:
        shown = sum(1 for _ in ImageSequence.Iterator(film))
    assert 1 < shown <= int(said.split()[0]) < 200  # equal pictures are stored once


def test_a_film_shows_a_program_of_ones_own_in_perspective_if_it_can(tmp_path, capsys) -> None:
    opengl()
    path, program = tmp_path / "own.gif", "THEN(NEAR(HAND, SPHERE), NEAR(HAND, BLUE))"
    arguments = ["film", "--program", program, "--width", "64", "--out", str(path)]
    assert main(arguments) == 0
    assert capsys.readouterr().out.endswith("not reached: none\n")
    with Image.open(path) as film:
        width, height = film.size
    assert main([*arguments, "--no-rendered"]) == 0
    with Image.open(path) as film:
        assert film.size == (width, height + width // 4)  # from above it is a square
    assert main(["film", "--program", "NEAR(HAND, AND(RED, GREEN))", *arguments[3:]]) == 2
    assert "expected a design with a scene for it" in capsys.readouterr().err


def test_an_unknown_condition_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "film.gif")
    assert main(["film", "--condition", "chain-3", "--out", out]) == 2
    assert "chain-2" in capsys.readouterr().err
