"""What the other benchmarks compute from their measurements."""

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import pytest

from laboratory.__main__ import BENCHMARKS, main
from laboratory.benchmarks import arena, baselines, networks_alone, peers
from laboratory.benchmarks.camera import Uses
from laboratory.benchmarks.latency import Latencies
from laboratory.benchmarks.peers import OURS, PeerScore, run_contender
from laboratory.studies.tables import read_rows, write_rows
from pa_ros.core.errors import ConfigError


def test_a_command_is_timed_from_the_step_that_it_answers():
    times = Latencies()
    times.observed(100, "a", 1.0)
    times.observed(100, "a", 1.5)  # the same step again
    assert not times.commanded(100, 2.0) and times.steps == [1.0]
    assert not times.commanded(200, 3.0) and times.steps == [1.0]  # a step without observation


def test_a_program_is_timed_until_a_command_answers_a_step_under_it():
    times = Latencies()
    times.observed(100, "a", 1.0)
    times.sent("b", 1.2)
    assert not times.commanded(100, 1.3)  # still under the one before
    times.observed(200, "b", 2.0)
    assert times.commanded(200, 2.2) and times.programs == pytest.approx([1.0])
    times.observed(300, "b", 3.0)
    assert not times.commanded(300, 3.1) and len(times.programs) == 1


def test_a_picture_is_timed_until_the_command_of_the_first_step_that_follows_it():
    times = Uses()
    step, picture, command = range(3)
    for kind, stamp_ns, now_s in [
        (step, 100, 1.0), (picture, 100, 1.1), (command, 100, 1.15),  # too late for its step
        (picture, 200, 1.2), (step, 200, 1.3), (command, 200, 1.4), (command, 200, 1.5),
    ]:  # fmt: skip
        times.wrote(kind, stamp_ns, now_s)
    assert times.latencies_s == pytest.approx([0.3, 0.2]) and not times.pictures


def test_latencies_are_reported_as_percentiles_in_milliseconds():
    times = Latencies(steps=[0.001 * i for i in range(1, 1002)], programs=[0.5])
    found = times.figures()
    assert found["step_p50_ms"] == pytest.approx(501) and found["step_p99_ms"] == pytest.approx(991)
    assert found["program_p999_ms"] == 500 and found["steps"] == 1001 and found["programs"] == 1


@pytest.mark.parametrize("name", BENCHMARKS)
def test_each_benchmark_says_its_options(name: str, capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["laboratory", name, "--help"])
    with pytest.raises(SystemExit, match="0"):
        main()
    assert "--json" in capsys.readouterr().out


def test_the_arena_is_fast_and_the_script_beats_chance(monkeypatch) -> None:
    monkeypatch.setattr(arena, "STEPS", 100)
    options = Namespace(episodes=1, arm="", presets=["fast"], design="2-L")
    found = {name: float(value) for name, value in arena.run(options).items()}
    assert found["arena.fast.steps_per_s"] > 0
    assert found["arena.fast.NEAR.script"] > found["arena.fast.NEAR.random"]
    options = Namespace(episodes=2, arm="panda", presets=["push"], design="push-2")
    ends = [f"arena.push.{condition}.success" for condition in ("train", "eval", "pairs")]
    assert arena.run(options) == dict.fromkeys(ends, 1.0)


def score(name: str, frames: float, seconds: float, train: float) -> PeerScore:
    return PeerScore(name, "a-library 1.2", 0, frames, seconds, train, train, train / 2, train / 2)


def test_our_scores_do_not_count_the_time_that_scoring_takes(tmp_path: Path) -> None:
    run_contender(OURS, 0, 400, tmp_path / "run.csv", every=200, episodes=1)
    rows = read_rows(tmp_path / "run.csv", PeerScore)
    assert [row.frames for row in rows] == [200, 400]
    assert 0 < rows[0].seconds < rows[1].seconds
    assert all(0 <= row.train_success <= 1 for row in rows)


def test_peers_are_compared_at_equal_frames_and_in_equal_time() -> None:
    rows = [score(OURS, 15_000, 20.0, 1.0), score(OURS, 60_000, 90.0, 1.0)]
    rows += [score("TD3", f, f / 500, s) for f, s in ((5000, 0.1), (15_000, 0.2), (60_000, 0.4))]
    found = peers.report(rows)
    assert found["peers.TD3.frames"] == 60_000 and found["peers.TD3.train_success"] == 0.4
    assert found["peers.TD3.at_15000.held_out_success"] == 0.1
    assert found["peers.TD3.in_time.frames"] == 5000  # the next score came after 30 s
    assert found["peers.ours.in_time.frames"] == 15_000


def test_finished_runs_are_not_repeated_and_a_missing_library_is_an_error(tmp_path, monkeypatch):
    options = Namespace(runs=tmp_path, seeds=2, frames=15_000, contenders=[OURS])
    for seed in range(2):
        rows = [replace(score(OURS, 15_000, 20.0, 1.0), seed=seed)]
        write_rows(tmp_path / f"{OURS}-{seed}.csv", rows)
    assert peers.run(options)["peers.ours.seeds"] == 2
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    options.contenders = ["TQC"]
    with pytest.raises(ConfigError, match="TQC needs sb3_contrib"):
        peers.run(options)


@pytest.mark.parametrize("method", baselines.METHODS)
def test_every_baseline_learns_from_relabeled_batches_and_is_scored(method, tmp_path, monkeypatch):
    monkeypatch.setattr(baselines, "WARMUP_FRAMES", 150)
    options = Namespace(
        design="2-L", preset="fast", seeds=1, first_seed=3, frames=200, episodes=1, rates=2.0,
        methods=[method], runs=tmp_path, table=tmp_path / "table.csv",
    )  # fmt: skip
    found = baselines.run(options)
    stated = {name.split(".")[-2] for name in found if name.endswith("success")}
    conjunctions = {"train", "eval", "ignore-new"}
    words = {"word-1", "word-2"}  # on 2-L no word names three blocks
    can = {"canonical": conjunctions}
    can |= dict.fromkeys(("deep-sets", "sac"), conjunctions | words)
    assert stated == can.get(method, conjunctions | words | {"depth-6"})
    assert found[f"baselines.2-L.{method}.200.2.train.seeds"] == 1
    assert len(read_rows(tmp_path / "table.csv", baselines.BaselineScore)) == len(stated)
    assert baselines.run(options) == found  # not trained again


def test_networks_alone_take_blocks_but_seldom_build_towers(capsys) -> None:
    asked = Namespace(agents=["shipped:stack"], condition=["hold", "tower-3"], episodes=4)
    report = networks_alone.run(asked)
    assert report["shipped:stack.hold.success"] == report["shipped:stack.hold.ever"] == 1
    assert report["shipped:stack.tower-3.success"] <= 0.5  # with the rules, 1
    assert "shipped:stack, hold: 1.00, ever 1.00" in capsys.readouterr().out
