"""Model cards say what was measured, in words that model hubs read."""

import json
import re
import sys
from pathlib import Path

import pytest
import yaml

import pa_ros
from laboratory.studies.cards import SCORES, model_card
from pa_ros.agents import load_agent
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.learning.checkpoint_files import SHIPPED

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import results_tables  # noqa: E402  (a script beside the docs)


@pytest.mark.parametrize("name", sorted(folder.name for folder in SHIPPED.iterdir()))
def test_the_card_of_a_shipped_agent_is_made_from_its_recorded_scores(name):
    card = (SHIPPED / name / "README.md").read_text()
    assert card == results_tables.card(SHIPPED / name)
    (result,) = yaml.safe_load(card.split("---\n")[1])["model-index"]
    scores = {(m["type"], m["name"]) for m in result["results"][0]["metrics"]}
    named = [(kind, name) for kind in SCORES for name in ("held-out programs", "trained programs")]
    assert scores == {*named}
    rows = card.partition("| --- |")[2].splitlines()[1:]
    assert [row.count("|") for row in rows[: len(named) + 4]] == [4] * 8  # two, and the lowest six
    assert result["name"].endswith("-camera") == (name == "camera")
    for function in re.findall(r"`pa_ros\.(\w+)\(", card):
        assert function in pa_ros.__all__


def test_a_card_has_scores_that_a_hub_reads(tmp_path):
    agent = load_agent("shipped:2-L")
    report: dict[str, float | int | str] = {
        "eval.eval.normalized": 0.25,
        "eval.eval.success_rate": 0.5,
        "versions": "software 1",
        "eval.episodes": 7,
        "eval.weights": agent.digest,
    }
    scores, card = tmp_path / "scores.json", tmp_path / "card.md"
    scores.write_text(json.dumps(report))
    given = ["--card", str(card), "--scores", str(scores)]
    assert main(["export", "shipped:2-L", *given]) == 0
    header = yaml.safe_load(card.read_text().split("---\n")[1])
    (result,) = header["model-index"][0]["results"]
    assert result["metrics"] == [
        {"type": "normalized", "name": "held-out programs", "value": 0.25},
        {"type": "success_rate", "name": "held-out programs", "value": 0.5},
    ]
    assert "| held-out programs | 0.25 | 50% |" in card.read_text()
    del report["eval.eval.normalized"]  # agents that move blocks have shares of success alone
    assert "| held-out programs | – | 50% |" in model_card("shipped:2-L", report)
    scores.write_text(json.dumps(report | {"eval.weights": "another"}))
    assert main(["export", "shipped:3-D", *given]) == 2
    with pytest.raises(ConfigError, match="expected measured scores, got none"):
        model_card("shipped:2-L", {"eval.weights": agent.digest})
