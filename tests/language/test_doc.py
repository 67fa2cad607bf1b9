"""The commands and code of docs/language.md print what the page shows."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pa_ros.cli.main import main
from pa_ros.language.errors import SUMMARIES

DOC = (Path(__file__).parents[2] / "docs" / "language.md").read_text("utf-8")
EXAMPLES = re.findall(r"^\$ pa_ros (.*)\n((?:(?!\$|```).*\n)+)", DOC, flags=re.MULTILINE)

BLOCKS = re.findall(r"^```python\n(.*?)^```", DOC, flags=re.MULTILINE | re.DOTALL)


def test_the_code_runs_and_gives_what_the_page_says() -> None:
    names: dict[str, Any] = {}
    for block in BLOCKS:
        exec(compile(block, "docs/language.md", "exec"), names)
    phi, p, row = names["phi"], names["p"], names["vocabulary"].row
    for i, red_or_no_cube in enumerate((phi[0, row["RED"]], 1 - phi[1, row["CUBE"]])):
        expected = [1.0, *red_or_no_cube[1:].tolist()]  # the hand's first
        np.testing.assert_allclose(p[i], expected, atol=1e-6)


@pytest.mark.parametrize(("command", "printed"), EXAMPLES)
def test_examples_print_what_the_page_says(
    command: str, printed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(shlex.split(command))
    out, err = capsys.readouterr()
    assert out + err == printed
    assert status == (2 if err else 0)


def test_the_table_lists_every_code() -> None:
    assert set(re.findall(r"^\| `(program\.\w+)` \|", DOC, flags=re.MULTILINE)) == set(SUMMARIES)
