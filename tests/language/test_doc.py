"""The code of docs/language.md does what the page says, and its table lists every code."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.language.errors import SUMMARIES

DOC = (Path(__file__).parents[2] / "docs" / "language.md").read_text("utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", DOC, flags=re.MULTILINE | re.DOTALL)


def test_the_code_runs_and_gives_what_the_page_says() -> None:
    names: dict[str, Any] = {}
    for block in BLOCKS:
        exec(compile(block, "docs/language.md", "exec"), names)
    phi, p, row = names["phi"], names["p"], names["vocabulary"].row
    for i, red_or_no_cube in enumerate((phi[0, row["RED"]], 1 - phi[1, row["CUBE"]])):
        expected = [1.0, *red_or_no_cube[1:].tolist()]  # the hand's first
        np.testing.assert_allclose(p[i], expected, atol=1e-6)


def test_the_table_lists_every_code() -> None:
    assert set(re.findall(r"^\| `(program\.\w+)` \|", DOC, flags=re.MULTILINE)) == set(SUMMARIES)
