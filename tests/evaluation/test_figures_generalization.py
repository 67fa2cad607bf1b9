"""The generalization plot and the detectors' pictures: of what they are given, and small."""

import json

import matplotlib.image
import numpy as np
import pytest

from pa_ros.arena import RenderError
from pa_ros.evaluation.pictures import generalization as figures_generalization
from pa_ros.evaluation.pictures.generalization import detector_figure, generalization_figure
from pa_ros.evaluation.results import redraw_generalization
from pa_ros.evaluation.scoring.agents import TrainedAgent
from pa_ros.evaluation.scoring.tables import TableError, write_rows
from pa_ros.evaluation.studies.generalization import CONDITIONS, Row


def table(level: float) -> list[Row]:
    rng = np.random.default_rng(0)
    return [
        Row(seed, condition, episode, "P", float(rng.normal(level, 0.1)), True, 0.1, 0.8, -1.0,
            -0.4, -0.2, -0.3)
        for condition in CONDITIONS for seed in (0, 1) for episode in range(5)
    ]  # fmt: skip


def test_generalization_figure(tmp_path):
    pictures = []
    for level in (-0.5, 0.7):
        path = tmp_path / "new" / f"{level}.png"
        generalization_figure(path, table(level), "3-D")
        pictures.append(matplotlib.image.imread(path)[..., :3])
        assert path.stat().st_size < 100_000
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.003
    generalization_figure(tmp_path / "one.png", table(0.5)[:10], "one condition")


def test_detector_figure_with_and_without_opengl(novice: TrainedAgent, tmp_path, monkeypatch):
    two_cases = tmp_path / "2.png"
    detector_figure(two_cases, novice, 2, "novice")
    assert two_cases.stat().st_size < 120_000

    def refuse(*_: object) -> None:
        raise RenderError("no OpenGL")

    monkeypatch.setattr(figures_generalization, "render", refuse)
    from_above = tmp_path / "above.png"
    detector_figure(from_above, novice, 2, "novice")
    assert matplotlib.image.imread(from_above)[..., :3].std() > 0.05


@pytest.mark.parametrize(
    ("lines", "agents", "said"),
    [
        (-1, {"0": {}}, r"expected 5 episodes of each of 2 seeds, got 9 rows"),
        (1, {"0": {}}, "expected rows"),
        (None, 3, "agents by seed"),
    ],
)
def test_a_damaged_table_is_refused(tmp_path, lines, agents, said):
    path = tmp_path / "generalization.csv"
    write_rows(path, table(0.5))
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:lines]))
    facts = {"design": "3-D", "preset": "fast", "agents": agents, "episodes": 5}
    path.with_suffix(".json").write_text(json.dumps(facts))
    with pytest.raises(TableError, match=said):
        redraw_generalization(path)
