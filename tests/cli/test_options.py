"""Options that follow from settings, and the choice of relations."""

import argparse
from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field

from pa_ros.arena.config import ArenaChoice
from pa_ros.cli.main import main
from pa_ros.cli.options import add_setting, add_settings, settings_from
from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Settings
from pa_ros.world.relation import RELATIONS


class Some(Settings):
    out: Path = Field(description="folder")
    steps: int = Field(5, ge=1, description="how many, 100 % of them")
    rate: float = Field(0.5, gt=0, description="how fast")
    kind: Literal["a", "b"] = Field("b", description="which")
    names: tuple[str, ...] = Field((), description="of whom")
    loop: bool = Field(False, description="again")


@pytest.fixture
def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser()
    add_settings(made, Some, "out", "kind", "names", "loop")
    add_setting(made, Some, "steps", "--count", otherwise="the other's")
    add_setting(made, Some, "rate")
    return made


def test_what_is_not_given_has_the_settings_default(parser: argparse.ArgumentParser) -> None:
    assert settings_from(parser.parse_args(["--out", "x"]), Some) == Some(out=Path("x"))


def test_what_is_given_has_the_settings_type(parser: argparse.ArgumentParser) -> None:
    given = "--out x --count 7 --rate 2 --kind a --names p q --loop".split()
    asked = settings_from(parser.parse_args(given), Some)
    assert asked == Some(out=Path("x"), steps=7, rate=2.0, kind="a", names=("p", "q"), loop=True)


def test_help_tells_meaning_choices_and_default(parser: argparse.ArgumentParser) -> None:
    shown = " ".join(parser.format_help().split())
    assert "--count N how many, 100 % of them (the other's)" in shown
    assert "--rate X how fast (0.5)" in shown
    assert "which; one of a, b (b)" in shown
    assert "--out PATH folder --" in shown.replace("folder  ", "folder ")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--count", "0"], "--count: expected an integer of at least 1, got 0"),
        (["--rate", "inf"], "--rate: expected a positive number, got inf"),
        (["--kind", "c"], "--kind: expected one of ['a', 'b'], got c"),
    ],
)
def test_a_refusal_names_the_option(parser, given, message) -> None:
    with pytest.raises(ConfigError) as refusal:
        parser.parse_args(["--out", "x", *given])
    assert str(refusal.value) == message


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["eval", "--policy", "scripted", "--json", "{file}/x.json"], "expected a folder at"),
        (["eval", "--policy", "scripted", "--json", "{folder}"], "got a folder"),
        (["experiment", "programmable-2L", "--results", "{file}/x"], "expected a folder at"),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_work(tmp_path, capsys, arguments, said):
    (tmp_path / "file").touch()
    places = {"file": tmp_path / "file", "folder": tmp_path}
    assert main([argument.format(**places) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert said in captured.err and captured.out == ""


def test_an_opengl_that_is_not_there_is_one_line(monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "osmesa")

    def broken(name):
        raise AttributeError("no attribute 'glGetError'")

    monkeypatch.setattr("pa_ros.core.software.importlib.import_module", broken)
    assert main(["eval", "--policy", "scripted"]) == 2
    assert "MUJOCO_GL=osmesa: expected an OpenGL" in capsys.readouterr().err


@pytest.mark.parametrize("number", ["999", "abc"])
def test_a_ros_domain_without_ports_is_one_line(monkeypatch, capsys, number):
    monkeypatch.setenv("ROS_DOMAIN_ID", number)
    assert main(["send", "NEAR(HAND, RED)"]) == 2
    assert f"ROS_DOMAIN_ID: expected 0 to 232, got '{number}'" in capsys.readouterr().err


def test_a_choice_of_relations_is_the_designs() -> None:
    chosen = ArenaChoice(relations=("ABOVE", "NEAR")).design_of()
    assert chosen.vocabulary.relations == ("ABOVE", "NEAR")
    assert ArenaChoice().design_of().vocabulary.relations == ("NEAR",)


def test_an_unknown_relation_is_refused_with_the_known_ones(tmp_path, capsys) -> None:
    with pytest.raises(ConfigError, match=r"relations: expected some of \[.*'NEAR'.*\], got"):
        ArenaChoice(relations=("NEAR", "BELOW"))
    assert main(["train", "--relations", "NEAR", "BELOW", "--out", str(tmp_path / "run")]) == 2
    refusal = capsys.readouterr().err
    assert "BELOW" in refusal and all(repr(name) in refusal for name in RELATIONS)


def test_the_program_command_knows_what_the_agent_of_a_launch_knows(capsys) -> None:
    check = ["program", "check"]
    assert main([*check, "LEFT_OF(HAND,RED)", "--relations", "NEAR", "LEFT_OF"]) == 0
    assert capsys.readouterr().out == "LEFT_OF(HAND, RED)\n"
    for text, said in (("LEFT_OF(HAND, RED)", "expected NEAR,"), ("NEAR(HAND, YELLOW)", "A, B,")):
        assert main([*check, text]) == 2
        assert said in capsys.readouterr().err
    assert main([*check, "NEAR(HAND, A)"]) == 0
    assert main([*check, "NEAR(HAND, A)", "--design", "2-L"]) == 2


def test_a_script_is_scored_on_a_relation(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--policy", "scripted", "--relations", "ABOVE", "--condition", "train"]
    assert main(["eval", *options, "--episodes", "2"]) == 0
    assert "ABOVE(HAND, AND(" in capsys.readouterr().out
