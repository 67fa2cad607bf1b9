"""Pictures of learning curves, conditions, detectors and variants, from tables."""

from collections.abc import Iterator
from dataclasses import replace

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from laboratory.studies import generalization_figures, learning_figures
from laboratory.studies.experiments import EXPERIMENTS, summarize, write_table
from laboratory.studies.generalization import ConditionRow
from laboratory.studies.learning_figures import is_curves, learning_figure, short, variants_figure
from laboratory.studies.tables import EvaluationError
from laboratory.studies.variants import Variant
from pa_ros.agents import load_agent
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.cli.main import main
from pa_ros.evaluation.drawing import draw_detectors


def rows(*scores):
    names = ("train_greedy.normalized", "eval_greedy.normalized")
    return [
        {"frames": 1000.0 * i, "wall_s": float(i)} | dict.fromkeys(names, score)
        for i, score in enumerate(scores, start=1)
    ]


def curves_table(folder, curves, name="programmable-2L"):
    summaries = [summarize(seed, own) for seed, own in curves.items()]
    return write_table(folder, EXPERIMENTS[name], curves, summaries)


def test_detectors_are_drawn_beside_the_arena(tmp_path):
    task = ReachTask(preset_named("fast"), design_named("3-D"), seed=0)
    pictures = []
    for episode in range(2):
        seen, _ = task.reset(episode)
        path = tmp_path / f"{episode}.png"
        explanation = load_agent("shipped:3-D").explain(seen, "NEAR(HAND, RED)")
        draw_detectors(path, task, explanation, "NEAR(HAND, RED)")
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


@pytest.fixture
def drawn(monkeypatch) -> Iterator[list[Figure]]:
    """The pictures of a test, which are not written."""
    pictures: list[Figure] = []
    for module in (generalization_figures, learning_figures):
        monkeypatch.setattr(module, "save", lambda figure, path: pictures.append(figure))
    yield pictures
    plt.close("all")


def test_lines_show_the_means_of_the_references(tmp_path, drawn) -> None:
    row = ConditionRow(0, "train", 0, "", 0.1, True, 0.1, scripted=0.8, random=-0.9, nearest=0.2,
                       any=-0.5, most=-0.4)  # fmt: skip
    rows = [row, replace(row, episode=1, scripted=0.6, nearest=0.4)]
    generalization_figures.generalization_figure(tmp_path / "a.png", rows, "")
    lines = [c for c in drawn[0].axes[0].collections if isinstance(c, LineCollection)]
    heights = [segment[:, 1] for line in lines for segment in line.get_segments()]
    np.testing.assert_allclose(heights, [[0.7, 0.7], [0.3, 0.3]])


def test_each_condition_has_its_best_and_its_worst_scene(tmp_path, monkeypatch, drawn, novice):
    monkeypatch.setattr(generalization_figures, "top_view", lambda *_: np.zeros((2, 2)))
    generalization_figures.detector_figure(tmp_path / "a.png", novice, 1, "")
    titles = [axes.get_ylabel().partition("\n")[0] for axes in drawn[0].axes[::2]]
    assert len(titles) == 4 and [t.rpartition(" ")[2] for t in titles] == ["best", "worst"] * 2


def test_seeds_that_never_solved_are_counted_at_the_edge_of_their_row(tmp_path, drawn) -> None:
    names = [f"learner.updates.discount={i}" for i in range(3)]
    variants = [Variant(n, n, 2, 3000, 1, 2000, 2, 0.9, 0.8, 1.0) for n in names]
    seeds = [summarize(0, rows(0.1, 0.95)), summarize(1, rows(0.1, 0.2))]
    for count in (1, 3):
        of = {row.label: seeds for row in variants[:count]}
        variants_figure(tmp_path / "a.png", variants[:count], of)
    heights = [figure.get_figheight() for figure in drawn]
    assert heights[1] - heights[0] > 0.5  # inches, or labels of rows would overlap
    texts = drawn[1].axes[1].texts
    assert [(t.get_position(), t.get_text()) for t in texts] == [
        ((1.0, y), "1 never ") for y in range(3)
    ]


@pytest.mark.parametrize("head", ["seed,frames", "frames"])
def test_a_table_without_seeds_is_rejected(tmp_path, head):
    table = tmp_path / "empty.csv"
    table.write_text(f"{head},train_greedy.normalized\n")
    with pytest.raises(EvaluationError, match="expected learning curves with a column seed"):
        learning_figure(table)


@pytest.mark.parametrize(
    ("changed", "words"),
    [("", ""), ("learner.updates.discount=0.99 learner.relabeling.rule=none",
                "discount=0.99, rule=none")],
)  # fmt: skip
def test_a_variant_is_named_after_its_change(changed: str, words: str) -> None:
    assert short(changed) == words
