"""The examples of docs/arena.md run as they stand."""

from pathlib import Path

import pytest

DOC = Path(__file__).parents[2] / "docs" / "arena.md"
EXAMPLES = [part.split("```")[0] for part in DOC.read_text().split("```python\n")[1:]]


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_runs(example: str) -> None:
    exec(compile(example, str(DOC), "exec"), {})
