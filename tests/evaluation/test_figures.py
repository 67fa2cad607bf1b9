"""Pictures of learning curves, conditions, detectors and variants, from tables."""

import json
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from pa_ros.arena import ReachTask, RenderError, design_named, preset_named
from pa_ros.cli.main import main
from pa_ros.evaluation import generalization_figures, learning_figures
from pa_ros.evaluation.agents import TrainedAgent
from pa_ros.evaluation.drawing import draw_detectors, learning_curve
from pa_ros.evaluation.experiments import experiment_named, summarize, write_table
from pa_ros.evaluation.generalization import CONDITIONS, Row
from pa_ros.evaluation.generalization_figures import detector_figure, generalization_figure
from pa_ros.evaluation.learning_figures import in_words, is_curves, learning_figure
from pa_ros.evaluation.results import redraw_generalization
from pa_ros.evaluation.tables import EvaluationError, write_rows


def rows(*scores):
    names = ("train_greedy.normalized", "eval_greedy.normalized")
    return [
        {"frames": 1000.0 * i, "wall_s": float(i)} | dict.fromkeys(names, score)
        for i, score in enumerate(scores, start=1)
    ]


def curves_table(folder, curves, name="programmable-2L"):
    summaries = [summarize(seed, own) for seed, own in curves.items()]
    return write_table(folder, experiment_named(name), curves, summaries)


def test_a_demonstrations_curve_may_have_gaps(tmp_path):
    path = tmp_path / "new" / "curve.png"
    learning_curve(
        path, [1, 2, 3], [-0.9, 0.1, 0.6], [np.nan, 0.0, 0.5], "2-L", references=(-0.97, 0.88)
    )
    assert matplotlib.image.imread(path)[..., :3].std() > 0.01


def test_detectors_are_drawn_beside_the_arena(tmp_path):
    task = ReachTask(preset_named("fast"), design_named("3-D"), seed=0)
    pictures = []
    for episode in range(2):
        seen, _ = task.reset(episode)
        path = tmp_path / f"{episode}.png"
        draw_detectors(path, Path("shipped:3-D"), task, seen, "NEAR(HAND, RED)")
        pictures.append(matplotlib.image.imread(path))
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.002


@pytest.mark.parametrize("name", ["programmable-2L", "forgetting"])
def test_the_command_draws_every_table_of_curves(tmp_path, capsys, name):
    table = curves_table(tmp_path, {0: rows(0.1, 0.5, 0.9), 4: rows(0.2, 0.3)}, name)
    assert is_curves(table) and not is_curves(tmp_path / f"{name}-seeds.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "binary.json").write_text("{}")
    assert main(["figures", "--results", str(tmp_path)]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / f"{name}.png")
    assert table.with_suffix(".png").stat().st_size < 100_000
    assert main(["figures", "absent", "--results", str(tmp_path)]) == 2
    assert name in capsys.readouterr().err


def test_a_table_without_rows_is_rejected(tmp_path):
    table = tmp_path / "empty.csv"
    table.write_text("seed,frames,wall_s,train_greedy.normalized\n")
    with pytest.raises(EvaluationError, match="expected rows, got none"):
        learning_figure(table)


@pytest.mark.parametrize(("count", "mean"), [(3, False), (7, True)])
def test_many_seeds_have_a_mean_with_its_interval(monkeypatch, tmp_path, count, mean):
    figures = []
    monkeypatch.setattr(learning_figures, "save", lambda figure, path: figures.append(figure))
    lengths = {seed: 4 if seed == 0 else 6 for seed in range(count)}
    scores = {seed: [0.1 * i for i in range(length)] for seed, length in lengths.items()}
    learning_figure(curves_table(tmp_path, {seed: rows(*own) for seed, own in scores.items()}))
    (axes,) = figures[0].axes
    labels = [text.get_text() for text in figures[0].legends[0].get_texts()]
    assert bool(axes.collections) == ("95 % interval of the mean" in labels) == mean
    assert ("seed 2" in labels) != mean
    if mean:  # it continues past the shortest seed
        thick = [line for line in axes.lines if line.get_linewidth() == 2 and len(line.get_xdata())]
        assert [max(line.get_xdata()) for line in thick] == [6000.0, 6000.0]


def table(level: float) -> list[Row]:
    rng = np.random.default_rng(0)
    return [
        Row(seed, condition, episode, "P", float(rng.normal(level, 0.1)), True, 0.1, 0.8, -1.0,
            -0.4, -0.2, -0.3)
        for condition in CONDITIONS for seed in (0, 1) for episode in range(5)
    ]  # fmt: skip


def test_the_generalization_figure_shows_the_scores(tmp_path):
    pictures = []
    for level in (-0.5, 0.7):
        path = tmp_path / "new" / f"{level}.png"
        generalization_figure(path, table(level), "3-D")
        pictures.append(matplotlib.image.imread(path)[..., :3])
        assert path.stat().st_size < 100_000
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.003


def test_a_damaged_table_of_conditions_is_rejected(tmp_path):
    path = tmp_path / "generalization.csv"
    write_rows(path, table(0.5)[:-1])
    facts = {"design": "3-D", "preset": "fast", "agents": {"0": {}}, "episodes": 5}
    path.with_suffix(".json").write_text(json.dumps(facts))
    with pytest.raises(EvaluationError, match="expected 5 episodes of each of 2 seeds, got 9"):
        redraw_generalization(path)


def test_the_detector_figure_needs_no_opengl(novice: TrainedAgent, tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise RenderError("no OpenGL")

    monkeypatch.setattr(generalization_figures, "render", refuse)
    from_above = tmp_path / "above.png"
    detector_figure(from_above, novice, 2, "novice")
    assert matplotlib.image.imread(from_above)[..., :3].std() > 0.05
    assert from_above.stat().st_size < 120_000


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ("", ""),
        ("learner.updates.discount=0.99", "discount 0.99"),
        ("learner.relabeling.rule=none", "relabeling: no"),
        ("learner.replay.batch_size=32", "batch size 32"),
    ],
)
def test_a_variant_is_named_after_its_change(changed: str, words: str) -> None:
    assert in_words(changed) == words
