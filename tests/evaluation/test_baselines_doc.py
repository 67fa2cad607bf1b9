"""docs/baselines.md runs as it stands, but for the number of frames and episodes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pa_ros.arena import conditions_for, design_named

DOC = Path(__file__).parents[2] / "docs/baselines.md"
SIZES = "FRAMES, EPISODES, SEED = 10_000, 20, 0"


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_another_librarys_agent_is_trained_and_scored(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("stable_baselines3")
    blocks = re.findall(r"```python\n(.*?)```", DOC.read_text(), re.DOTALL)
    assert len(blocks) == 1 and SIZES in blocks[0]
    exec(blocks[0].replace(SIZES, "FRAMES, EPISODES, SEED = 110, 1, 0"), {})  # noqa: S102
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(conditions_for(design_named("2-L")))
    assert all(len(line.split()) == 3 for line in lines)
