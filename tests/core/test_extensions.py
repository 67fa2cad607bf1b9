"""Registries by name, and the extensions that add to them."""

from pathlib import Path

import pytest

from pa_ros.cli.main import main
from pa_ros.core import extensions
from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import Registry


def test_items_are_found_in_the_order_of_registering() -> None:
    arms: Registry[float] = Registry("arm")
    assert arms.register("long", 2.0) == 2.0
    arms.register("short", 1.0)
    assert list(arms) == ["long", "short"] and arms["short"] == 1.0
    assert "long" in arms and "none" not in arms


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    arms: Registry[float] = Registry("arm")
    arms.register("long", 2.0)
    with pytest.raises(ConfigError, match=r"^unknown arm: expected one of \['long'\], got 'x'; "):
        arms["x"]


def test_a_second_of_one_name_is_refused_and_the_same_again_is_not() -> None:
    arms: Registry[object] = Registry("arm")
    item = arms.register("long", object())
    assert arms.register("long", item) is item
    with pytest.raises(ConfigError, match="arm 'long': expected a new name"):
        arms.register("long", object())
    assert arms["long"] is item


def test_an_extension_is_a_file_or_a_module_and_runs_once(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("import itertools\nruns = []\nruns.append(1)\n")
    first, calendar = extensions.load([str(path), "calendar"])
    (again,) = extensions.load([str(path)])
    assert first is again and first.runs == [1] and calendar.__name__ == "calendar"


@pytest.mark.parametrize(
    ("text", "why"),
    [("1 / 0", "ZeroDivisionError"), ("exit(0)", "SystemExit: 0"), (None, "No such file")],
)
def test_an_extension_that_cannot_be_imported_is_named(tmp_path, capsys, text, why) -> None:
    path = tmp_path / "broken.py"
    if text is not None:
        path.write_text(text)
    assert main(["program", "check", "NEAR(HAND, RED)", "--extension", str(path)]) == 2
    said = capsys.readouterr().err
    assert "broken.py" in said and why in said
    with pytest.raises(ConfigError, match="broken.py"):  # not half there the second time
        extensions.load([str(path)])


@pytest.mark.parametrize("place", [0, 3])
def test_an_extension_is_named_anywhere_on_the_line(tmp_path, capsys, place: int) -> None:
    line = ["bag", "info", str(tmp_path / "none")]
    line[place:place] = ["--extension", "calendar"]
    assert main(line) == 2
    assert "expected a bag, found none" in capsys.readouterr().err
