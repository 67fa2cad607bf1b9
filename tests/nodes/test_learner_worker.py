"""The learner behind its topic: idempotent, in a fixed ratio, resumable (invariants 3 and 5)."""

import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from helpers.learners import ARENA, small, trajectory
from helpers.waiting import wait_for
from learner_node.config import LearnerNodeConfig
from learner_node.worker import LearnerWorker, Sinks
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, PublishedPolicy
from pa_ros.language import Vocabulary, parse
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.folder import checkpoint_of
from pa_ros.world import Trajectory

OPTIONS = small(0, 4, 8, attention=4)
A = AgentKey("a", 0)


class Bench:
    """A worker and what it said."""

    def __init__(self, **config) -> None:
        self.published: list[PublishedPolicy] = []
        self.refused: list[PaError] = []
        self.told: list[str] = []  # for the log
        refuse = lambda _, error: self.refused.append(error)  # noqa: E731
        sinks = Sinks(self.published.append, refuse, self.told.append)
        self.worker = LearnerWorker(LearnerNodeConfig(**OPTIONS | config), ARENA, sinks)
        self.worker.start()

    def submit(self, *trajectories: Trajectory) -> PublishedPolicy:
        """Submit, and wait for the answer to the last."""
        wanted = len(self.published) + len(trajectories)
        for one in trajectories:
            self.worker.submit(one)
        wait_for(lambda: len(self.published) >= wanted or self.worker.failure, "the answer")
        assert self.worker.failure is None
        return self.published[-1]


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.worker.close()


def test_each_trajectory_makes_one_version_and_its_number_of_updates(bench):
    assert [p.snapshot.version for p in bench.published] == [0]
    last = bench.submit(trajectory(0), trajectory(1), trajectory(2, length=7))
    assert [p.snapshot.version for p in bench.published] == [0, 1, 2, 3]
    assert last.accounted == {A: 3}
    assert [p.latest for p in bench.published] == [None, (*A, 0), (*A, 1), (*A, 2)]
    assert bench.worker.metrics["updates"] == bench.worker.metrics["frames"] == 27


def test_a_duplicate_trajectory_is_counted_and_changes_nothing(bench):
    first = bench.submit(trajectory(0))
    again = bench.submit(trajectory(0))
    assert again.snapshot.version == first.snapshot.version == 1
    assert bench.worker.metrics["duplicate_trajectories"] == 1
    assert bench.worker.metrics["updates"] == 10
    for name, tensor in first.snapshot.tensors.items():
        assert np.array_equal(again.snapshot.tensors[name], tensor)


@pytest.mark.parametrize("held_from", [0, 10**6])
@pytest.mark.parametrize("known", [True, False])
def test_a_number_far_ahead_of_a_working_agent_is_rejected_and_changes_nothing(
    bench, known, held_from
):
    if known:
        bench.submit(trajectory(0))
    elif held_from:
        return  # an agent that was there before its learner
    before = bench.worker.run.learner.replay.ledger.to_metadata()
    bench.submit(replace(trajectory(10**6), held_from=held_from))
    assert [error.code for error in bench.refused] == ["learning.ahead"]
    assert bench.worker.run.learner.replay.ledger.to_metadata() == before
    assert bench.submit(trajectory(1 if known else 0)).accounted == {A: 2 if known else 1}


def test_an_agent_that_was_cut_off_for_long_continues_at_its_number(bench, monkeypatch):
    bench.submit(trajectory(0))
    monkeypatch.setattr("pa_ros.learning.run.SILENT_S", 0.0)
    assert bench.submit(replace(trajectory(5000), held_from=4999)).accounted == {A: 4999}
    assert bench.worker.metrics["lost_trajectories"] == 4998


@pytest.mark.parametrize("known", [True, False])
def test_what_a_killed_learner_forgot_is_lost_also_of_an_agent_that_it_does_not_know(
    tmp_path: Path, known
):
    """A learner learned 0 to 7 after its newest checkpoint, and was killed."""
    first = Bench(out=str(tmp_path))
    if known:
        first.submit(trajectory(0))
    first.worker.close()
    second = Bench(out=str(tmp_path), resume=True)
    run_id = second.worker.run.info.run_id
    of_this_run = replace(trajectory(8), run_id=run_id, held_from=8)
    of_another = replace(trajectory(5, "b"), held_from=5)
    assert second.submit(of_this_run, of_another).accounted == {A: 9, AgentKey("b", 0): 6}
    second.worker.close()
    figures = second.worker.metrics
    assert figures["version"] + figures["lost_trajectories"] == 9 + 1


def test_nobody_who_uses_an_agents_name_bars_it(tmp_path: Path):
    """Neither at once nor after a restart: the checkpoint remembers each incarnation."""
    first = Bench(out=str(tmp_path))
    first.submit(trajectory(0), trajectory(1), replace(trajectory(0), incarnation=2**64 - 1))
    assert first.submit(trajectory(2)).accounted == {A: 3, AgentKey("a", 2**64 - 1): 1}
    first.worker.close()
    second = Bench(out=str(tmp_path), resume=True)
    restarted = replace(trajectory(0), incarnation=1)
    assert second.submit(trajectory(3), restarted).snapshot.version == 6
    second.worker.close()
    assert not second.refused and second.worker.metrics["duplicate_trajectories"] == 0


def test_a_trajectory_that_cannot_be_used_is_refused_and_accounted_for(bench):
    unknown = parse("NEAR(HAND, PINK)", Vocabulary.of(shape=("CUBE",), color=("PINK",)))
    answer = bench.submit(replace(trajectory(0), program=unknown))
    assert [error.code for error in bench.refused] == ["program.unknown_word"]
    assert bench.worker.metrics["rejected_trajectories"] == 1
    assert (answer.snapshot.version, answer.accounted) == (0, {A: 1})
    assert bench.submit(trajectory(1)).snapshot.version == 1


def test_a_learner_resumes_where_it_stopped(tmp_path: Path):
    unbroken = Bench()
    unbroken.submit(*(trajectory(i) for i in range(5)))
    unbroken.worker.close()
    first = Bench(out=str(tmp_path))
    first.submit(*(trajectory(i) for i in range(3)))
    first.worker.close()
    second = Bench(out=str(tmp_path), resume=True)
    assert [p.snapshot.version for p in second.published] == [2, 3]  # what may be asked for
    assert [p.accounted for p in second.published] == [{}, {A: 3}]
    was, now = first.worker.run.info, second.worker.run.info
    assert (now.run_id, now.first_version) == (was.run_id, 3) and now.learner_id != was.learner_id
    last = second.submit(trajectory(3), trajectory(4))
    second.worker.close()
    assert last.snapshot.version == 5
    for name, tensor in unbroken.published[-1].snapshot.tensors.items():
        assert np.array_equal(last.snapshot.tensors[name], tensor), name


def test_a_checkpoint_that_cannot_be_written_is_reported_until_one_is(tmp_path: Path, monkeypatch):
    bench = Bench(out=str(tmp_path), checkpoint_every_frames=10)
    with monkeypatch.context() as patch:
        full = Mock(side_effect=OSError("No space left"))
        patch.setattr("pa_ros.learning.checkpoint_files.os.rename", full)
        bench.submit(trajectory(0), trajectory(1))
        wait_for(lambda: len(bench.refused) == 2)
        assert "not saved" in bench.worker.trouble and "No space left" in bench.worker.trouble
        assert [path.name for path in (tmp_path / "checkpoint").iterdir()] == []
    assert not bench.told
    bench.submit(trajectory(2))
    wait_for(lambda: not bench.worker.trouble)
    bench.worker.close()
    assert bench.told[0].startswith("checkpoint: version 3 after ")


def test_divergence_stops_learning_and_saves_nothing(tmp_path: Path):
    wild = {"learner.optimizer.critic_rate": 1e30}
    bench = Bench(out=str(tmp_path), checkpoint_every_frames=10, **wild)
    for i in range(5):
        bench.worker.submit(trajectory(i))
    wait_for(lambda: bench.worker.trouble)
    assert "expected finite numbers" in bench.worker.trouble
    learned = len(bench.published) - 1
    wait_for(lambda: len(bench.refused) == 5 - learned, "the rest to be refused")
    for i in range(5, 8):
        bench.worker.submit(trajectory(i))
    wait_for(lambda: len(bench.refused) == 8 - learned, "what still comes to be refused")
    assert {error.code for error in bench.refused} == {"learning.diverged"}
    assert bench.worker.backlog == 0
    for policy in bench.published:
        assert all(np.isfinite(tensor).all() for tensor in policy.snapshot.tensors.values())
    before = sorted(path.name for path in tmp_path.rglob("version-*"))
    bench.worker.close()
    assert sorted(path.name for path in tmp_path.rglob("version-*")) == before


def test_the_state_before_divergence_is_saved(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("pa_ros.learning.learner.SAVED_BEFORE", 1)
    wild = {"learner.optimizer.critic_rate": 1e30}
    bench = Bench(out=str(tmp_path), **wild)
    for i in range(5):
        bench.worker.submit(trajectory(i))
    wait_for(lambda: bench.worker.trouble)
    last = bench.published[-1].snapshot.version
    bench.worker.close()
    assert "expected finite numbers" in bench.worker.trouble
    assert [path.name for path in tmp_path.rglob("version-*")] == [f"version-{last:09d}"]
    counters = read_metadata(checkpoint_of(tmp_path))["counters"]
    assert (counters["version"], counters["updates"]) == (last, counters["frames"])
    again = Bench(out=str(tmp_path), **wild, resume=True)
    assert again.published[-1].snapshot.version == last


def test_a_paused_worker_saves_and_learns_again_when_resumed(tmp_path):
    bench = Bench(out=str(tmp_path))
    bench.submit(trajectory(0))
    bench.worker.pause()
    assert read_metadata(checkpoint_of(tmp_path))["counters"]["version"] == 1
    bench.worker.submit(trajectory(1))
    time.sleep(0.2)
    assert bench.worker.metrics["frames"] == 10 and len(bench.published) == 2
    bench.worker.resume()
    bench.submit(trajectory(2))
    wait_for(lambda: bench.worker.metrics["frames"] == 30, "both")
    bench.worker.pause()
    bench.worker.submit(trajectory(3))
    bench.worker.close()  # its agent may be gone
    assert read_metadata(checkpoint_of(tmp_path))["counters"]["version"] == 4


def test_in_a_fixed_order_a_rejected_sender_gets_no_weights_within_a_round():
    bench = Bench(agents=("a", "b"), **{"learner.schedule.in_step": "exact"})
    bench.worker.submit(trajectory(0, "a"))  # the round still lacks b's
    bench.worker.submit(trajectory(0, "stranger"))
    wait_for(lambda: bench.refused, "the rejection")
    assert [error.code for error in bench.refused] == ["learning.turn"]
    assert bench.submit(trajectory(0, "b")).snapshot.version == 2
    bench.worker.close()
    assert [p.snapshot.version for p in bench.published] == [0, 2]
