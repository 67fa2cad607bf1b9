"""docs/starting.md: its commands' options are known, and its block scores an agent."""

import re
import shlex
from pathlib import Path

import pytest

from pa_ros.cli.main import build_parser

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


@pytest.mark.parametrize("page", [PAGE, PAGE.parents[1] / "README.md"])
def test_its_pictures_are_there_and_small(page):
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())
    assert pictures
    for path in pictures:
        assert 0 < (page.parent / path).stat().st_size < 1_500_000
