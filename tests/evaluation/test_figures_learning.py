"""Learning curves from tables: drawn, with the switch of programs, or refused."""

import json

import pytest

from pa_ros.cli.main import main
from pa_ros.evaluation.pictures import learning
from pa_ros.evaluation.pictures.learning import algorithms_figure, is_curves, learning_figure
from pa_ros.evaluation.scoring.tables import TableError
from pa_ros.evaluation.studies.experiments import experiment_named, summarize, write_table


def rows(*scores):
    names = ("train_greedy.normalized", "eval_greedy.normalized")
    return [
        {"frames": 1000.0 * i, "wall_s": float(i)} | dict.fromkeys(names, score)
        for i, score in enumerate(scores, start=1)
    ]


@pytest.mark.parametrize("name", ["programmable-2L", "forgetting"])
def test_every_seed_is_drawn_also_one_that_stopped_early(tmp_path, name):
    curves = {0: rows(0.1, 0.5, 0.9), 4: rows(0.2, 0.3)}
    summaries = [summarize(seed, own) for seed, own in curves.items()]
    table = write_table(tmp_path, experiment_named(name), curves, summaries)
    assert is_curves(table) and not is_curves(tmp_path / f"{name}-seeds.csv")
    picture = learning_figure(table)
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size < 100_000


def test_tables_of_0_1_are_drawn_too(tmp_path):
    """Their settings had no parts."""
    table = write_table(
        tmp_path,
        experiment_named("forgetting"),
        {0: rows(0.1, 0.9)},
        [summarize(0, rows(0.1, 0.9))],
    )
    setting = json.loads(table.with_suffix(".json").read_text())
    setting["learner"] = {"replay_frames": 50_000}
    table.with_suffix(".json").write_text(json.dumps(setting))
    assert learning_figure(table).exists()


def test_the_command_draws_what_is_there_and_names_it(tmp_path, capsys):
    curves = {0: rows(0.1, 0.95)}
    write_table(tmp_path, experiment_named("canonical-2C"), curves, [summarize(0, curves[0])])
    assert main(["figures", "--results", str(tmp_path)]) == 0
    assert capsys.readouterr().out.strip().endswith("canonical-2C.png")
    assert main(["figures", "absent", "--results", str(tmp_path)]) == 2
    assert "canonical-2C" in capsys.readouterr().err


def test_a_table_without_rows_is_refused(tmp_path):
    table = tmp_path / "empty.csv"
    table.write_text("seed,frames,wall_s\n")
    table.with_suffix(".json").write_text(json.dumps({}))
    with pytest.raises(TableError, match="at least one row"):
        learning_figure(table)


@pytest.mark.parametrize(
    "setting",
    [
        {"switch_frames": "abc"},
        {"switch_frames": None},
        {"learner": 3},
        {"learner": {}},
        {"learner": {"replay": {}}},
    ],
)
def test_a_setting_of_other_kinds_is_refused(tmp_path, setting, capsys):
    curves = {0: rows(0.1, 0.95)}
    table = write_table(tmp_path, experiment_named("forgetting"), curves, [summarize(0, curves[0])])
    beside = table.with_suffix(".json")
    beside.write_text(json.dumps(json.loads(beside.read_text()) | setting))
    assert main(["figures", "--results", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"pa_ros figures: {table}: ")


def test_curves_without_scores_are_refused(tmp_path):
    curves = {0: rows(0.1, 0.95)}
    table = write_table(tmp_path, experiment_named("forgetting"), curves, [summarize(0, curves[0])])
    table.write_text("seed,frames,wall_s\n0,1000,1\n")
    with pytest.raises(TableError, match="expected a column of .*train_greedy"):
        learning_figure(table)


def test_what_is_no_table_is_passed_over(tmp_path, capsys):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "binary.json").write_text("{}")
    (tmp_path / "folder.csv").mkdir()
    assert main(["figures", "--results", str(tmp_path)]) == 0
    assert capsys.readouterr().out == ""


def drawn(monkeypatch, tmp_path, count, lengths):
    """Figure of a table of so many seeds."""
    figures = []
    monkeypatch.setattr(learning, "save", lambda figure, path: figures.append(figure))
    curves = {seed: rows(*(0.1 * i for i in range(lengths(seed)))) for seed in range(count)}
    summaries = [summarize(seed, own) for seed, own in curves.items()]
    table = write_table(tmp_path, experiment_named("programmable-2L"), curves, summaries)
    learning_figure(table)
    return figures[0]


def test_few_seeds_are_each_a_line_and_the_legend_says_which(monkeypatch, tmp_path):
    figure = drawn(monkeypatch, tmp_path, 3, lambda seed: 4 + seed)
    (axes,) = figure.axes
    assert not axes.collections, "a band over three seeds hides them"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[-3:] == ["seed 0", "seed 1", "seed 2"] and axes.get_legend() is None


def test_a_mean_of_many_goes_on_past_the_shortest_seed_and_the_band_is_explained(
    monkeypatch, tmp_path
):
    figure = drawn(monkeypatch, tmp_path, 7, lambda seed: 4 if seed == 0 else 6)
    (axes,) = figure.axes
    means = [line for line in axes.lines if line.get_linewidth() == 2 and len(line.get_xdata())]
    assert [max(line.get_xdata()) for line in means] == [6000.0, 6000.0]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "95 % interval of the mean" in labels and "mean of the seeds" in labels


@pytest.mark.parametrize("seeds", [1, 5])
def test_every_algorithm_is_drawn_and_looks_like_no_other(tmp_path, monkeypatch, seeds):
    curves = {seed: rows(0.1, 0.9) for seed in range(seeds)}
    summaries = [summarize(seed, own) for seed, own in curves.items()]
    table = write_table(tmp_path, experiment_named("programmable-2L"), curves, summaries)
    figures = []
    monkeypatch.setattr(learning, "save", lambda figure, path: figures.append(figure))
    algorithms_figure(tmp_path / "algorithms.png", {f"mine{i}": table for i in range(9)})
    lines = figures[0].axes[0].get_lines()
    labels = [line for line in lines if line.get_label().startswith("mine")]
    assert [line.get_label().split(",")[0] for line in labels] == [f"mine{i}" for i in range(9)]
    looks = {(line.get_color(), line.get_marker()) for line in labels}
    assert len(looks) == 9
    curves_drawn = [line for line in lines if len(line.get_xdata()) and line.get_alpha() is None]
    assert looks < {(line.get_color(), line.get_marker()) for line in curves_drawn}
