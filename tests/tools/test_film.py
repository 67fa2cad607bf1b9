"""Films of an agent that executes one goal over time."""

from pathlib import Path

import pytest
from PIL import Image, ImageSequence

from pa_ros.cli.main import main


def test_a_film_shows_the_goal_of_a_condition_until_it_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "chain.gif"
    chain = ["--condition", "chain-2", "--width", "64"]
    assert main(["film", "--checkpoint", "shipped:3-D", *chain, "--out", str(path)]) == 0
    said = capsys.readouterr().out
    assert said.endswith("not reached: none\n")
    with Image.open(path) as film:
        shown = sum(1 for _ in ImageSequence.Iterator(film))
    assert 1 < shown <= int(said.split()[0]) < 200  # equal pictures are stored once


def test_an_unknown_condition_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "film.gif")
    assert main(["film", "--condition", "chain-3", "--out", out]) == 2
    assert "chain-2" in capsys.readouterr().err
