"""What a benchmark of fleets says of runs that were made, and which it would make."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from pa_ros.benchmarks.fleet import Run, planned, report, runs_in
from pa_ros.benchmarks.fleet_figure import draw_fleet
from pa_ros.benchmarks.fleet_runs import Request

CURVE = [(10.0, 1000.0, 0.1), (100.0, 9000.0, 0.95)]
RUNS = [
    Run(1, 0, 1.0, True, 100.0, seconds=100.0, curve=CURVE),
    Run(1, 1, 1.0, True, 90.0, seconds=200.0, too_old=2, load=3.0),
    Run(2, 0, 1.0, True, 180.0, seconds=50.0, load=4.5),
    Run(2, 1, 1.0, True, 170.0),
    Run(4, 0, 1.0, True, 300.0),
    Run(1, 0, 0.25, False, 900.0),
]


def test_medians_are_of_the_runs_that_came_there_and_say_how_many_they_are():
    found = report(RUNS)
    assert found["fleet.seconds_1"] == 150.0 and found["fleet.seconds_2"] == 50.0
    assert found["fleet.speedup_2"] == 3.0
    assert (found["fleet.runs_2"], found["fleet.reached_2"]) == (2, 1)
    assert found["fleet.reached_4"] == 0 and "fleet.speedup_4" not in found
    assert found["fleet.frames_per_s_1"] == 95.0 and found["fleet.too_old_1"] == 2
    assert found["fleet.unthrottled_1_at_0.25"] == 900.0
    assert found["fleet.load_highest"] == 4.5


def test_runs_are_kept_one_by_one_and_drawn(tmp_path: Path):
    for number, run in enumerate(RUNS):
        (tmp_path / f"{number}.json").write_text(json.dumps(asdict(run)))
    kept = runs_in(tmp_path)
    assert [run.arenas for run in kept] == [1, 1, 2, 2, 4, 1]
    assert kept[0].curve == [list(point) for point in CURVE]
    draw_fleet(tmp_path / "picture.png", kept)
    assert (tmp_path / "picture.png").stat().st_size > 5000


def test_whole_seeds_are_planned_one_after_the_other():
    plan = list(planned(3, (1, 4)))
    assert [(r.seed, r.arenas) for r in plan if r.throttled] == [
        (0, 1), (0, 4), (1, 1), (1, 4), (2, 1), (2, 4),
    ]  # fmt: skip
    assert sum(not r.throttled for r in plan) == 9


@pytest.mark.parametrize("arenas", [1, 3])
def test_arenas_of_a_run_have_seeds_of_their_own(arenas: int):
    parameters = Request(arenas, {"seed": 200}, 2, ["learner.updates.per_frame=1"], "free")
    nodes = parameters.parameters()
    seeds = [nodes[f"arena{i + 1}/sim_node"]["seed"] for i in range(arenas)]
    assert seeds == [200 + i for i in range(arenas)]
    assert nodes["learner_node"]["options"][-1] == "learner.schedule.in_step=free"
