"""docs/starting.md: its commands' options are known, and its block scores an agent."""

import re
import shlex
from pathlib import Path

import pytest

from pa_ros.cli.main import build_parser, main
from pa_ros.evaluation.scoring.agents import load_agent
from pa_ros.evaluation.scoring.evaluate import evaluate

PAGE = Path(__file__).parents[2] / "docs/starting.md"
COMMANDS = [
    line.partition("   #")[0].strip()
    for block in re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for line in block.splitlines()
]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_are_known_to_the_last_option(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, name, *arguments = shlex.split(command)
    assert program == "pa_ros"
    build_parser(name).parse_args([name, *arguments])


def test_a_policy_is_scored_on_all_conditions(capsys):
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    exec(compile(block, str(PAGE), "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    scores = {line.split()[0]: float(line.split()[1]) for line in lines}
    assert {"train", "eval", "only-color", "reach-new-both"} <= scores.keys()
    assert scores["train"] > 0.8


def test_the_command_that_is_said_to_give_the_same_does(capsys, monkeypatch):
    """To the last digit that it prints."""
    said = r"`pa_ros (eval --checkpoint shipped:3-D --condition all[^`]*)`"
    (command,) = re.findall(said, PAGE.read_text())
    (episodes, seed) = re.findall(r"condition, (\d+), seed=([\d_]+)\)", PAGE.read_text())[0]
    monkeypatch.setattr("pa_ros.cli.evaluate.conditions_of", lambda _: ("only-shape", "depth-4"))
    assert main(shlex.split(command)) == 0
    agent = load_agent(Path("shipped:3-D"))
    for line in capsys.readouterr().out.splitlines()[:2]:
        condition, normalized, *_ = line.split()
        scores = evaluate(
            agent.arena, agent.design, agent.policy, condition, int(episodes), int(seed)
        )
        assert normalized == f"{scores.normalized.mean:.3f}"


@pytest.mark.parametrize("page", [PAGE, PAGE.parents[1] / "README.md"])
def test_its_pictures_are_there_and_small(page):
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())
    assert pictures
    for path in pictures:
        assert 0 < (page.parent / path).stat().st_size < 1_500_000
