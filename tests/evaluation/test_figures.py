"""Pictures of learning curves, conditions, detectors and variants, from tables."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.cli.main import main
from pa_ros.evaluation.drawing import draw_detectors
from pa_ros.evaluation.experiments import EXPERIMENTS, summarize, write_table
from pa_ros.evaluation.learning_figures import is_curves, learning_figure, short
from pa_ros.evaluation.tables import EvaluationError


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
