"""Seeds as tasks of a Ray cluster, with a stand-in for Ray that runs them in this process."""

import socket
import sys
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from laboratory.studies import cluster
from laboratory.studies.cluster import SeedJob
from laboratory.studies.experiments import EXPERIMENTS, Experiment, run_seed
from laboratory.studies.seeds import folder_of, train_seeds
from laboratory.studies.tables import CURVE, EvaluationError, frames_done
from pa_ros.agents import load_agent
from pa_ros.cli.main import main
from pa_ros.core.errors import PaError
from pa_ros.learning.folder import claim

SMALL = replace(
    EXPERIMENTS["programmable-2L"],
    frames=400,
    evaluate_every_frames=200,
    evaluation_episodes=1,
    options={"learner.replay.warmup_frames": 100, "learner.replay.batch_size": 8},
)


class LocalRay:
    """Ray as far as `Cluster.run` needs it; the first parts are lost with their nodes."""

    class exceptions:
        class RayError(Exception):
            pass

        class RayTaskError(RayError):
            cause: Exception

    def __init__(self, losses: int = 1) -> None:
        self.losses, self.most = losses, 0  # to come; parts at a time so far

    def remote(self, **_: Any) -> Any:
        return lambda work: SimpleNamespace(remote=lambda *given: partial(work, *given))

    def wait(self, running: list[Any], timeout: float) -> tuple[list[Any], list[Any]]:
        self.most = max(self.most, len(running))
        return running[:1], running[1:]

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 2.0}

    def get(self, task: Any) -> Any:
        if self.losses:
            self.losses -= 1
            raise self.exceptions.RayError
        try:
            return task()
        except PaError as error:
            failed = self.exceptions.RayTaskError()
            failed.cause = error
            raise failed from error


def on_this_machine(ray: LocalRay | None = None) -> cluster.Cluster:
    local = object.__new__(cluster.Cluster)
    local._ray, local._extended = ray or LocalRay(), ()
    return local


def test_a_lost_part_is_repeated_and_a_failed_seed_does_not_stop_the_others(tmp_path) -> None:
    messages: list[str] = []
    ray = LocalRay()
    local = on_this_machine(ray)
    wrong = replace(SMALL, options={"learner.updates.discount": float("nan")})
    jobs = [SeedJob(wrong if seed == 1 else SMALL, seed, tmp_path / f"seed-{seed}")
            for seed in range(3)]  # fmt: skip
    with pytest.raises(EvaluationError, match=r"seed 1: .*discount.*got nan"):
        local.run(jobs, lambda: None, messages.append)
    assert [line.partition(":")[0] for line in messages] == ["seed 0", "seed 1 failed"]
    assert ray.most == 2  # as many as there are processors
    for seed in (0, 2):
        assert frames_done(tmp_path / f"seed-{seed}" / CURVE) == SMALL.frames
    run_seed(SMALL, 0, tmp_path / "here")
    assert load_agent(tmp_path / "seed-0").digest == load_agent(tmp_path / "here").digest


def test_a_part_that_is_lost_each_time_ends_the_job(tmp_path) -> None:
    ray = LocalRay(losses=99)
    with pytest.raises(EvaluationError, match="seed 0: lost the same part 5 times"):
        on_this_machine(ray).run([SeedJob(SMALL, 0, tmp_path)], lambda: None, lambda line: None)
    assert 99 - ray.losses == cluster.LOSSES


@pytest.mark.parametrize(("done", "until"), [(0, 100), (150, 200), (350, 390)])
def test_a_part_ends_at_the_next_checkpoint(tmp_path, monkeypatch, done, until) -> None:
    monkeypatch.setattr(cluster, "frames_saved", lambda _: done)
    monkeypatch.setattr(Experiment, "checkpoint_every_frames", 100)
    part: Any = SeedJob(replace(SMALL, frames=390, evaluate_every_frames=195), 0, tmp_path).part()
    assert part.train.keywords == {"until": until}


def test_on_one_machine_too_a_failed_seed_does_not_stop_the_others(tmp_path, capsys) -> None:
    with (
        claim(folder_of(tmp_path, 0)),
        pytest.raises(EvaluationError, match="seed 0: .*another run writes into"),
    ):
        train_seeds(SMALL, (0, 1), tmp_path, jobs=1)
    assert frames_done(folder_of(tmp_path, 1) / CURVE) == SMALL.frames
    printed = capsys.readouterr().out  # without a terminal the bar is shown only at the end
    assert "seed 0 failed" in printed and "seed 1 is trained" in printed


def rejected(capsys: pytest.CaptureFixture[str], address: str, name: str = "programmable-2L"):
    assert main(["experiment", name, "--cluster", address, "--seeds", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_cluster_that_cannot_be_used_is_one_line(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "_import_ray", lambda: None)
    assert "expected HOST:PORT of Ray's head, got 'ray://x'" in rejected(capsys, "ray://x")
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        free = "{}:{}".format(*nobody.getsockname())
    assert f"got '{free}': [Errno 111]" in rejected(capsys, free)
    assert "expected training, got the study detectors" in rejected(capsys, free, "detectors")


def test_without_ray_the_error_names_its_extra(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "ray", None)
    assert 'pip install "programmable-agents[cluster]"' in rejected(capsys, "127.0.0.1:1")


def test_a_node_with_other_software_is_rejected():
    with pytest.raises(EvaluationError, match="expected python 2 on every node"):
        cluster.do_part(cluster.Part(print, {}), "python 2", ())
