"""The examples of docs/arena.md run as they stand."""

from pathlib import Path

import pytest

DOC = Path(__file__).parents[2] / "docs" / "arena.md"
EXAMPLES = [part.split("```")[0] for part in DOC.read_text().split("```python\n")[1:]]


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_runs(example: str) -> None:
    exec(compile(example, str(DOC), "exec"), {})


def test_presets_in_the_tables_are_the_real_ones() -> None:
    from pa_ros.arena import PRESETS

    text = DOC.read_text()
    assert set(PRESETS) == {"paper", "fast"}
    assert PRESETS["paper"].joint_speed_limits == (0.5,) * 6 and "| 0.5 each |" in text
    assert PRESETS["paper"].block_mass_kg == 1.0 and "**1.0 kg, friction 1.0**" in text
