"""Relations are chosen by name: options, settings, the program command."""

from pathlib import Path

import pytest

from pa_ros.arena.config import ArenaChoice
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.world.relation import RELATIONS


def test_a_choice_of_relations_is_the_designs() -> None:
    chosen = ArenaChoice(relations=("ABOVE", "NEAR")).design_of()
    assert chosen.vocabulary.relations == ("ABOVE", "NEAR")
    assert ArenaChoice().design_of().vocabulary.relations == ("NEAR",)


def test_an_unknown_relation_is_refused_with_the_known_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match=r"relations: expected some of \[.*'NEAR'.*\], got"):
        ArenaChoice(relations=("NEAR", "BELOW"))
    assert main(["train", "--relations", "NEAR", "BELOW", "--out", str(tmp_path / "run")]) == 2
    refusal = capsys.readouterr().err
    assert "BELOW" in refusal and all(repr(name) in refusal for name in RELATIONS)


def test_the_program_command_knows_what_the_agent_of_a_launch_knows(
    capsys: pytest.CaptureFixture[str],
) -> None:
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
