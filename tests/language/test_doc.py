"""The code of docs/language.md does what the page says, and its table lists every code."""

import re
from pathlib import Path

import pytest

from pa_ros.language.errors import SUMMARIES

DOC = (Path(__file__).parents[2] / "docs" / "language.md").read_text("utf-8")
(BLOCK,) = re.findall(r"^```python\n(.*?)^```", DOC, flags=re.MULTILINE | re.DOTALL)


def test_the_code_runs_and_gives_what_the_page_says(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(BLOCK, "docs/language.md", "exec"), {})
    shown = capsys.readouterr().out.splitlines()
    assert [line.rpartition(" ")[2] for line in shown] == ["False", "False", "True"]


def test_the_table_lists_every_code() -> None:
    assert set(re.findall(r"^\| `(program\.\w+)` \|", DOC, flags=re.MULTILINE)) == set(SUMMARIES)
