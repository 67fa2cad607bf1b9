"""Other libraries' agents beside ours: the same frames, the same episodes, the same scores."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from pa_ros.benchmarks import peers
from pa_ros.benchmarks.peers import OURS, PACKAGES, PEERS, Score, report, run_contender
from pa_ros.benchmarks.peers_figure import draw_peers
from pa_ros.core.errors import ConfigError
from pa_ros.evaluation.scoring.tables import read_rows, write_rows
from pa_ros.evaluation.scoring.training import Acts, TrainingScores

FRAMES, EVERY, EPISODES = 1200, 600, 2


def score(name: str, frames: float, seconds: float, train: float) -> Score:
    return Score(name, "a-library 1.2", 0, frames, seconds, train, train, train / 2, train / 2)


def test_ours_is_scored_on_the_way_without_the_time_that_it_takes(tmp_path: Path) -> None:
    run_contender(OURS, 0, FRAMES, tmp_path / "run.csv", EVERY, EPISODES)
    rows = read_rows(tmp_path / "run.csv", Score)
    assert [row.frames for row in rows] == [600, 1200]
    assert {row.library for row in rows} == {
        f"programmable-agents {version('programmable-agents')}"
    }
    assert 0 < rows[0].seconds < rows[1].seconds
    assert all(0 <= row.train_success <= 1 for row in rows)


@pytest.mark.filterwarnings("ignore")  # of the libraries
@pytest.mark.parametrize("name", PEERS)
def test_each_peer_learns_and_is_scored(name: str, tmp_path: Path) -> None:
    pytest.importorskip(PEERS[name][0])
    run_contender(name, 0, 200, tmp_path / "run.csv", 100, 1)
    rows = read_rows(tmp_path / "run.csv", Score)
    assert [row.frames for row in rows] == [100, 200]
    assert {row.contender for row in rows} == {name}
    assert rows[0].library == f"{PACKAGES[PEERS[name][0]]} {version(PACKAGES[PEERS[name][0]])}"
    assert 0 < rows[0].seconds < rows[1].seconds


def test_the_report_compares_at_equal_frames_and_in_equal_time() -> None:
    rows = [score(OURS, 15_000, 20.0, 1.0), score(OURS, 60_000, 90.0, 1.0)]
    rows += [score("TD3", f, f / 500, s) for f, s in ((5000, 0.1), (15_000, 0.2), (60_000, 0.4))]
    found = report(rows)
    assert found["peers.TD3.frames"] == 60_000 and found["peers.TD3.train_success"] == 0.4
    assert found["peers.TD3.at_15000.held_out_success"] == 0.1
    assert found["peers.TD3.in_time.frames"] == 5000  # the next was after 30 s
    assert found["peers.ours.in_time.frames"] == 15_000
    assert found["peers.TD3.library"] == "a-library 1.2"


def test_what_is_there_is_not_trained_again_and_what_cannot_be_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in range(2):
        rows = [replace(score(OURS, 15_000, 20.0, 1.0), seed=seed)]
        write_rows(tmp_path / f"{OURS}-{seed}.csv", rows)
    found = peers.bench_peers(tmp_path, 2, [OURS], frames=15_000)
    assert (
        found["peers.ours.seeds"] == 2 and "ours, seed 1: 15000 frames" in capsys.readouterr().out
    )
    draw_peers(tmp_path / "peers.png", peers.scores_in(tmp_path))
    assert (tmp_path / "peers.png").stat().st_size > 10_000
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    with pytest.raises(ConfigError, match="TQC expects sb3_contrib .the extra `peers`"):
        peers.bench_peers(tmp_path, 1, ["TQC"], frames=15_000)
    write_rows(tmp_path / "TQC-0.csv", [score("TQC", 15_000, 90.0, 0.1)])
    found = peers.bench_peers(tmp_path, 1, ["TQC"], frames=15_000)
    assert found["peers.TQC.seeds"] == 1  # a run needs no library
    with pytest.raises(ConfigError, match="TQC expects sb3_contrib"):
        peers.bench_peers(tmp_path, 1, ["TQC"], frames=17_500)  # it is too short
    with pytest.raises(ConfigError, match="expected of .*got 'PPO'"):
        peers.bench_peers(tmp_path, 1, ["PPO"], frames=15_000)


def test_a_run_is_as_long_as_asked_and_a_shorter_one_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def apart(name: str, _seed: int, frames: int, path: Path) -> None:
        made.append(frames)
        every = range(2500, frames + 1, 2500)
        write_rows(path, [score(name, frame, frame / 500, 1.0) for frame in every])

    monkeypatch.setattr(peers, "_apart", apart)
    for frames in (5000, 10_000, 5000):
        found = peers.bench_peers(tmp_path, 1, [OURS], frames)
    assert made == [5000, 10_000] and found["peers.ours.frames"] == 10_000
    with pytest.raises(ConfigError, match="expected a multiple of 2500, got 6000"):
        peers.bench_peers(tmp_path, 1, [OURS], 6000)


def test_a_run_that_is_stopped_leaves_its_scores_and_takes_no_longer_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.csv"
    there: list[float] = []

    class Stopped(Exception): ...

    def score_of(self: TrainingScores, actor: Acts) -> dict[str, float]:
        there.append(read_rows(path, Score)[-1].frames if path.exists() else 0)
        if len(there) == 3:
            raise Stopped
        return unchanged(self, actor)

    unchanged = TrainingScores.__call__
    monkeypatch.setattr(TrainingScores, "__call__", score_of)
    with pytest.raises(Stopped):
        run_contender(OURS, 0, 3 * EVERY, path, EVERY, EPISODES)
    assert there == [0, 600, 1200] and len(read_rows(path, Score)) == 2
    there.clear()
    with pytest.raises(Stopped):
        run_contender(OURS, 0, 6 * EVERY, path, EVERY // 2, EPISODES)
    assert there == [1200, 1200, 1200]  # two scores of an earlier run, until there are three
