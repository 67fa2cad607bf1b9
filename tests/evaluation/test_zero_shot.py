"""Experiments on trained agents leave tables that can be read back, and pictures."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation import results
from pa_ros.evaluation.scoring.agents import TrainedAgent, load_agent, without_training
from pa_ros.evaluation.scoring.tables import read_rows
from pa_ros.evaluation.studies.detectors import Accuracy
from pa_ros.evaluation.studies.equalities import LAWS, Difference
from pa_ros.evaluation.studies.generalization import CONDITIONS, Row, Summary


@pytest.fixture
def agents(novice: TrainedAgent) -> dict[int, TrainedAgent]:
    return {0: novice, 1: without_training(novice, 1)}


def test_generalization(agents, tmp_path):
    said: list[str] = []
    out = tmp_path / "results"
    summaries = results.generalization(agents, out, tmp_path / "cache", 2, ".x", said.append)
    rows = read_rows(out / "generalization.x.csv", Row)
    assert len(rows) == len(CONDITIONS) * 2 * 2 and len(said) == len(CONDITIONS) * 2
    assert [s.condition for s in summaries] == list(CONDITIONS)
    assert len(read_rows(out / "generalization-summary.x.csv", Summary)) == len(CONDITIONS)
    facts = json.loads((out / "generalization.x.json").read_text())
    assert facts["agents"]["1"]["weights"] == agents[1].digest
    picture = out / "generalization.x.png"
    before = picture.read_bytes()
    picture.unlink()
    assert results.redraw_generalization(out / "generalization.x.csv") == picture
    assert picture.read_bytes() == before


def test_chosen_conditions_alone(agents, tmp_path):
    found = results.generalization(
        agents, tmp_path, tmp_path / "cache", 1, report=lambda line: None, conditions=["depth-3"]
    )
    assert [summary.condition for summary in found] == ["depth-3"]
    with pytest.raises(ConfigError, match="nowhere"):
        results.generalization(agents, tmp_path, tmp_path, 1, conditions=["nowhere"])


def test_a_digest_is_of_tensors_by_name_whatever_their_order(novice: TrainedAgent):
    tensors = novice.snapshot.tensors
    turned = replace(novice.snapshot, tensors=dict(reversed(tensors.items())))
    assert list(turned.tensors) != list(tensors)
    assert replace(novice, snapshot=turned).digest == novice.digest


def test_random_weights_have_a_random_stream_of_their_own(novice: TrainedAgent):
    first = next(iter(without_training(novice, 7).snapshot.tensors.values()))
    streams = range(6)  # 0 arena, 1 exploration, 2 learner, 3 the random reference
    drawn = [np.random.default_rng([7, i]).uniform(-1, 1, first.shape) for i in streams]
    alike = [np.corrcoef(first.ravel(), numbers.ravel())[0, 1] > 0.999 for numbers in drawn]
    assert alike == [False, False, False, False, True, False]


def test_equalities_and_detectors(agents, tmp_path):
    assert len(results.equalities(agents, tmp_path, 1)) == 2 * 2 * len(LAWS)
    assert {row.seed for row in read_rows(tmp_path / "equalities.csv", Difference)} == {0, 1}
    results.detectors(agents, tmp_path, 1)
    assert {row.seed for row in read_rows(tmp_path / "detectors.csv", Accuracy)} == {0, 1}
    assert (tmp_path / "detectors.png").stat().st_size < 120_000
    assert json.loads((tmp_path / "detectors.json").read_text())["episodes"] == 1


def test_an_agent_of_a_checkpoint(tmp_path):
    run = ["train", "--out", str(tmp_path), "--design", "3-D", "--frames", "100", "--eval-every"]
    assert main([*run, "0"]) == 0
    agent, same = load_agent(tmp_path), load_agent(tmp_path / "checkpoint", "2-L", "paper")
    assert (agent.design.name, agent.arena.preset) == ("3-D", "fast")
    assert (same.design.name, same.arena.preset) == ("2-L", "paper")
    assert agent.digest == same.digest and len(agent.digest) == 12
