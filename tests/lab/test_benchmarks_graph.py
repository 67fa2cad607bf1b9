"""Each benchmark of running graphs measures something in one short round.

Those of arena, agent and learner share one graph, which learns slowly: the machine is for them.
"""

import json
import math
import os
import subprocess
import sys
from argparse import Namespace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from agent_node.config import AgentConfig
from helpers.graph import SMALL
from helpers.pictures import opengl
from helpers.waiting import DEADLINE_S, wait_for
from laboratory.benchmarks import camera, fleet, graph, latency, rehearsal, stacking, train
from learner_node.config import LearnerNodeConfig
from pa_ros.arena import design_named, preset_named
from pa_ros.core.text import Report
from pa_ros.evaluation.evaluate import TrainingScores
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from sim_node.config import SimConfig

pytestmark = pytest.mark.graph
RUNNING: Parameters = {  # four or five trajectories a second: rates change, as benchmarks expect
    "sim_node": {"design": "3-D", "mode": "real_time", "real_time_factor": 4.5},
    "agent_node": {"learning": True},
    "learner_node": SMALL,
}
CONFIGS = {"sim_node": SimConfig, "agent_node": AgentConfig, "learner_node": LearnerNodeConfig}


def positive(report: Report) -> bool:
    return all(math.isfinite(float(value)) and float(value) > 0 for value in report.values())


def test_a_pingpong_of_fixed_work(monkeypatch):
    monkeypatch.setattr(graph, "SECONDS", 0.1)
    assert graph.pingpong() > 0


def test_the_share_of_the_fixed_pingpong_falls_with_the_rate(monkeypatch):
    rates = {graph.RATE: 2000.0, graph.ARENA: 100.0, graph.POLICY: 50.0}
    monkeypatch.setattr(graph, "lockstep", lambda *_, **__: dict(rates))
    monkeypatch.setattr(graph, "pingpong", lambda: 4000.0)
    monkeypatch.setattr(graph, "use_free_domain", lambda: None)
    found = graph.run(Namespace(rounds=1))
    assert found["graph.of_fixed_pingpong"] == 0.5 and found[graph.FIXED] == 4000.0


@pytest.mark.skipif(not find_spec("cv2"), reason="the extra `camera` is not installed")
def test_latency_of_an_agent_that_sees():
    opengl()
    found = camera.run(Namespace(seconds=2.0, warm_up=0.0))
    assert float(found["camera.pictures"]) > 0


def test_a_program_on_a_robot(monkeypatch):
    monkeypatch.setattr(rehearsal, "SETTLE_S", 0.5)
    found = rehearsal.run(Namespace(scenes=1, tags=False, no_relay=False))
    assert found["arena"] == found["robot"] == 1.0
    assert 0 < float(found["command_p50_ms"]) <= float(found["command_p99_ms"])


def test_a_block_is_put_on_a_place_by_a_robot_with_a_gripper(monkeypatch):
    monkeypatch.setattr(stacking, "SETTLE_S", 0.5)
    monkeypatch.setattr(stacking, "CONDITION", "blocks-4")
    assert stacking.run(Namespace(scenes=1, told=0.03))["built"] == 1.0


@pytest.mark.parametrize("given", [["--tags"], ["--design", "push-2"]])
def test_an_arm_learns_as_its_camera_sees_tags_or_as_it_moves_blocks(given, tmp_path: Path):
    if "--tags" in given:
        pytest.importorskip("cv2", reason="the extra `camera` is not installed")
        opengl()
    file = tmp_path / "found.json"
    short = "--frames", "100", "--scenes", "2", "--json", str(file)
    command = [sys.executable, "-m", "laboratory", "on_the_arm", *short, *given]
    paths = os.pathsep.join(path for path in sys.path if path)
    subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, check=True)
    found = json.loads(file.read_text())
    assert found["arm.samples"] > 200  # two of the driver in each control period
    assert found["arm.frames"] == 100 and found["arm.above_speed"] == 0


@pytest.fixture(scope="module")
def learning(module_domain: str, tmp_path_factory: pytest.TempPathFactory):
    """A graph that learns."""
    folder, figures = tmp_path_factory.mktemp("graph"), GraphFigures()
    with Supervisor(folder) as supervisor:
        start_nodes(supervisor, RUNNING, folder, compose=True)
        with client_node("watcher") as node:
            watch_diagnostics(node, figures)
            updates = lambda: (figures.value("learner_node", "updates_per_s") or 0) > 0  # noqa: E731
            assert watch(node, supervisor, lambda: None, updates, DEADLINE_S)
        yield


@pytest.fixture
def running(learning, monkeypatch):
    """The benchmarks find the graph that learns instead of starting one, for which they must have
    parameters that the nodes accept."""

    def start(_: Supervisor, parameters: Parameters, folder: Path, compose: bool = False) -> None:
        for place, values in parameters.items():
            CONFIGS[place.rpartition("/")[2]](**values)

    for benchmark in (graph, latency):
        monkeypatch.setattr(benchmark, "start_nodes", start)
    monkeypatch.setattr(train, "use_free_domain", lambda: None)


def test_latencies_of_commands_and_programs(running):
    assert positive(latency.measure("real_time", 0.1, 0.01))


def test_steps_per_second_of_a_graph(running, monkeypatch):
    monkeypatch.setattr(graph, "SECONDS", 1.0)
    assert positive(graph.lockstep(graph.PARAMETERS))


def test_a_fleet_of_one_arena(running, monkeypatch):
    monkeypatch.setattr(fleet, "FRAMES", 100)
    scores = TrainingScores(preset_named("fast"), design_named("3-D"), episodes=1)
    rate, _ = fleet.measure(1, 0, scores, compose=True)
    assert rate > 0


def test_updates_while_a_graph_learns(running, monkeypatch):
    """In a second in which a busy machine gave the learner no time the rate is 0: once more."""
    monkeypatch.setattr(train, "SAMPLES", 1)
    monkeypatch.setattr(train, "BARE_S", 0.02)
    found: dict[str, Any] = {}

    def measured() -> bool:
        found.update(train.run(Namespace(rounds=1)))
        return found["graph.updates_per_s"] > 0

    wait_for(measured, "updates")
    assert positive(found)
