"""Each benchmark of running graphs measures something in one short round."""

import argparse
import math
from functools import partial
from importlib.util import find_spec

import pytest

from helpers.pictures import opengl
from helpers.recordings import SMALL
from laboratory.benchmarks import camera, fleet, graph, latency, rehearsal, train
from pa_ros.arena import design_named, preset_named
from pa_ros.core.text import Report
from pa_ros.evaluation.evaluate import TrainingScores
from pa_ros.tools.graph import start_nodes
from pa_ros.tools.launch_params import Parameters

pytestmark = pytest.mark.graph


def positive(report: Report) -> bool:
    return all(math.isfinite(float(value)) and float(value) > 0 for value in report.values())


@pytest.fixture(autouse=True)
def quick_to_start(monkeypatch):
    """All nodes of a graph in one process, which starts sooner."""
    for benchmark in (latency, train):
        monkeypatch.setattr(benchmark, "start_nodes", partial(start_nodes, compose=True))


def test_latencies_of_a_fast_graph():
    assert positive(latency.measure("lockstep", 0.1, 0.01, training=False))


def test_steps_per_second_beside_a_pingpong_of_fixed_work(monkeypatch):
    monkeypatch.setattr(graph, "SECONDS", 1.0)
    measured = graph.lockstep(graph.PARAMETERS, compose=True)
    assert positive(measured) and graph.pingpong(work=True) > 0


def test_the_share_of_the_fixed_pingpong_falls_with_the_rate(monkeypatch):
    rates = {graph.RATE: 2000.0, graph.ARENA: 100.0, graph.POLICY: 50.0}
    monkeypatch.setattr(graph, "lockstep", lambda *_, **__: dict(rates))
    monkeypatch.setattr(graph, "pingpong", lambda work=False: 4000.0 if work else 5000.0)
    found = graph.run(argparse.Namespace(rounds=1))
    assert found["graph.of_fixed_pingpong"] == 0.5 and found["graph.step_us"] == 500.0
    assert found["graph.nodes_us"] == 500.0 - 100.0 - 50.0 - 200.0


@pytest.mark.skipif(not find_spec("cv2"), reason="the extra `camera` is not installed")
def test_latency_of_an_agent_that_sees():
    opengl()
    found = camera.run(argparse.Namespace(seconds=0.5, warm_up=0.1))
    assert float(found["camera.pictures"]) > 0


def test_a_fleet_of_one_arena(monkeypatch):
    monkeypatch.setattr(fleet, "FRAMES", 100)
    scores = TrainingScores(preset_named("fast"), design_named("2-L"), episodes=1)
    rate, _ = fleet.measure(1, 0, scores, compose=True)
    assert rate > 0


def test_updates_while_a_graph_learns(monkeypatch):
    monkeypatch.setattr(train, "SAMPLES", 1)
    monkeypatch.setattr(train, "BARE_S", 0.02)
    quick: Parameters = {
        "sim_node": {},
        "agent_node": {"learning": True, "weights": "topic"},
        "learner_node": SMALL,
    }
    monkeypatch.setattr(train, "load_parameters", lambda _: quick)
    found = train.run(argparse.Namespace(rounds=1))
    # A busy machine may leave the graph a second without an update.
    assert float(found["graph.bare_updates_per_s"]) > 0 and float(found["graph.share_of_bare"]) >= 0


def test_a_program_on_a_robot(monkeypatch):
    monkeypatch.setattr(rehearsal, "SETTLE_S", 0.5)
    assert rehearsal.run(argparse.Namespace(scenes=1, tags=False)) == {"arena": 1.0, "robot": 1.0}
