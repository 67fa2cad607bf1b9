"""Extensions: code of the operator's own, imported by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from pa_ros.cli.main import main
from pa_ros.core import extensions
from pa_ros.core.errors import ConfigError


def test_an_extension_is_a_file_or_a_module_and_runs_once(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("import itertools\nruns = []\nruns.append(1)\n")
    (first, calendar), (again,) = (
        extensions.load([str(path), "calendar"]),
        extensions.load([str(path)]),
    )
    assert first is again and first.runs == [1] and calendar.__name__ == "calendar"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1 / 0", "ZeroDivisionError"),
        ("def", "SyntaxError"),
        ("exit(0)", "SystemExit: 0"),
        (None, "No such file"),
    ],
)
def test_an_extension_that_cannot_be_imported_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, why: str
) -> None:
    path = tmp_path / "broken.py"
    if text is not None:
        path.write_text(text)
    assert main(["program", "check", "NEAR(HAND, RED)", "--extension", str(path)]) == 2
    said = capsys.readouterr().err
    assert "broken.py" in said and why in said
    with pytest.raises(ConfigError, match="broken.py"):  # not half there the second time
        extensions.load([str(path)])


def test_a_module_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigError, match="got 'no_such_module': ModuleNotFoundError"):
        extensions.load(["no_such_module"])


@pytest.mark.parametrize("place", [0, 1, 2, 3])
def test_an_extension_is_named_anywhere_on_the_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], place: int
) -> None:
    line = ["bag", "info", str(tmp_path / "none")]
    line[place:place] = ["--extension", "calendar"]
    assert main(line) == 2
    assert "expected a bag, found none" in capsys.readouterr().err
