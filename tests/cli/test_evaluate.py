"""`pa_ros eval`: every condition by its name, random weights, all at once."""

import json

import pytest

from pa_ros.arena.formulas import FORMULAS
from pa_ros.cli.main import main
from pa_ros.evaluation.conditions import CONDITIONS
from pa_ros.evaluation.evaluate import EPISODES_SEED

pytestmark = pytest.mark.xdist_group("evaluate")  # its checkpoint is made once


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> str:
    """A 3-D agent of 200 frames."""
    folder = tmp_path_factory.mktemp("run")
    run = ["train", "--out", str(folder), "--design", "3-D", "--frames", "200", "--eval-every", "0"]
    assert main(run) == 0
    return str(folder)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_each_condition_by_its_name(checkpoint: str, condition: str, tmp_path, capsys):
    report = tmp_path / "eval.json"
    arguments = ["eval", "--checkpoint", checkpoint, "--condition", condition, "--episodes", "1"]
    assert main([*arguments, "--json", str(report)]) == 0
    figures = json.loads(report.read_text())
    assert figures["eval.condition"] == condition and figures["eval.design"] == "3-D"
    assert figures["eval.seed"] == EPISODES_SEED, "episodes that no training run sees"
    assert -1.0 <= figures["eval.reward_per_step"] <= 1.0
    # Programs are printed once; the report has them, too.
    assert capsys.readouterr().out.count("NEAR(HAND, ") == 1
    assert any(name.startswith("eval.program.NEAR(HAND, ") for name in figures)


@pytest.mark.parametrize("judge", ["verifier", "agent"])
def test_a_chain_says_how_far_it_came_and_how_well_the_agent_judges(judge, tmp_path, capsys):
    report = tmp_path / "eval.json"
    arguments = ["eval", "--checkpoint", "shipped:3-D", "--condition", "chain-2", "--judge", judge]
    assert main([*arguments, "--episodes", "2", "--json", str(report)]) == 0
    figures = json.loads(report.read_text())
    assert figures["eval.success"] == figures["eval.ever"] == 1.0
    assert figures["eval.programs_done"] == 2.0 and figures["eval.violations"] == 0.0
    assert figures["eval.judgement.steps"] == 2 * 200
    assert figures["eval.judgement.false_done"] < 0.1 and figures["eval.judgement.missed"] < 0.1
    assert "THEN(NEAR(HAND, " in capsys.readouterr().out


def test_comparisons_are_executed_without_training(tmp_path, capsys):
    report = tmp_path / "eval.json"
    arguments = ["eval", "--checkpoint", "shipped:3-D", "--condition", "compare-8"]
    assert main([*arguments, "--episodes", "3", "--json", str(report)]) == 0
    figures = json.loads(report.read_text())
    assert figures["eval.success"] == 1.0 and figures["eval.violations"] == 0.0
    assert "ST(" in capsys.readouterr().out  # as all comparisons end


def test_programs_of_ones_own_are_scored(tmp_path, capsys):
    report = tmp_path / "eval.json"
    asked = ["NEAR(HAND, SPHERE)", "NEAR(HAND, AND(NOT(RED), CUBE))"]
    arguments = ["eval", "--checkpoint", "shipped:3-D", "--program", *asked, "--episodes", "2"]
    assert main([*arguments, "--json", str(report)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.partition(": 2 episodes")[0] for row in rows[:2]] == asked
    figures = json.loads(report.read_text())
    assert figures["eval.success_rate"] == 1.0 and figures["eval.reward_per_step"] > 0.5


@pytest.mark.parametrize(("asked", "said"), [
    ("--policy scripted --design 3-D --program NEAR(HAND,RED)", "--program: needs --checkpoint"),
    ("--checkpoint shipped:3-D --program NEAR(HAND,RED) --layouts own", "without --program"),
    ("--policy scripted --design 3-D --judge agent", "--judge: needs --checkpoint"),
    ("--policy scripted --design 3-D --pictures hard", "--pictures: needs --checkpoint"),
    ("--checkpoint shipped:3-D --pictures hard", "--pictures: needs an agent that sees"),
    ("--checkpoint shipped:camera --condition all --pictures dim", "pictures: needs one condition"),
    ("--policy scripted --design 3-D --condition finite", "needs a design that avoids"),
    ("--checkpoint shipped:2-L --condition all --judge agent", "--judge: needs one condition"),
    ("--checkpoint shipped:avoid --condition finite --layouts own", "another condition"),
])  # fmt: skip
def test_options_that_would_not_count_are_refused(asked, said, capsys):
    assert main(["eval", *asked.split()]) == 2 and said in capsys.readouterr().err


def test_all_conditions_at_once(checkpoint: str, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pa_ros.cli.evaluate.conditions_of", lambda _: ("random", "reach-new-both"))
    report = tmp_path / "eval.json"
    arguments = ["eval", "--checkpoint", checkpoint, "--condition", "all", "--episodes", "2"]
    assert main([*arguments, "--json", str(report)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("random ") and printed[1].startswith("reach-new-both ")
    figures = json.loads(report.read_text())
    assert figures["eval.random.success_rate"] <= 1.0
    low, high = (figures[f"eval.reach-new-both.{end}"] for end in ("low", "high"))
    assert low <= figures["eval.reach-new-both.normalized"] <= high


def test_formulas_are_a_table(tmp_path, capsys):
    report = tmp_path / "eval.json"
    script = ["--policy", "scripted", "--design", "3-D-avoid", "--episodes", "2"]
    assert main(["eval", *script, "--condition", "finite", "--json", str(report)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:9]] == list(FORMULAS)
    figures = json.loads(report.read_text())
    assert figures["eval.finite-2.success"] + figures["eval.finite-2.violations"] == 1.0
