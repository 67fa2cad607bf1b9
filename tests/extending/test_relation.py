"""A custom relation is scored and learned."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from helpers.learners import trained
from pa_ros.arena import (
    ReachTask,
    design_named,
    mean_reward,
    preset_named,
    scripted_action,
    training_programs,
)
from pa_ros.arena.designs import Design
from pa_ros.arena.render import outline, top_view
from pa_ros.cli.main import main
from pa_ros.core import extensions
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.config import actor_config
from pa_ros.networks.parameters import initial_actor

WITHIN = str(Path(__file__).with_name("within.py"))
ARENA = preset_named("fast")


@pytest.fixture
def design() -> Iterator[Design]:
    extensions.load([WITHIN])
    yield design_named("2-L").with_relations("NEAR", "WITHIN")


def test_it_may_be_registered_before_the_designs_are_loaded() -> None:
    code = f"import runpy; runpy.run_path({WITHIN!r}); import pa_ros.arena"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_verifier_scores_it_and_the_script_satisfies_it(design: Design) -> None:
    task = ReachTask(ARENA, design.with_relations("WITHIN"), seed=0)
    assert mean_reward(task, scripted_action, 4) > 0.5
    distance = np.linalg.norm(task.simulation.objects()[task.verifier.targets[0], :3])
    _, verdict = task.set_program(task.program)
    assert verdict.satisfied and abs(distance - 0.30) <= 0.03
    assert np.allclose(np.ptp(outline(task), axis=0), 0.6, atol=1e-2)
    assert top_view(task, 96).shape == (96, 96, 3)


def test_it_is_learned_in_process(design: Design, tmp_path: Path) -> None:
    learner = trained(tmp_path, design=design)
    assert learner.counters.updates == 200
    assert len(learner.table) == 2 * len(training_programs(design_named("2-L")))
    weight = np.asarray(learner.engine.tensors()["actor.relation.weight"], np.float32)
    assert weight.shape == (16, 2) and np.abs(weight[:, 0] - weight[:, 1]).min() > 0
    before = initial_actor(learner.network, np.random.default_rng([0, 2]))["relation.weight"]
    assert not np.array_equal(weight, before)
    assert "WITHIN" in load_policy(tmp_path / "checkpoint").architecture


def test_each_program_is_relabeled_with_its_own_relation(design: Design, tmp_path: Path) -> None:
    """At 0.30 m from a block WITHIN holds and NEAR does not, and vice versa at 0.1 m."""
    learner, checked = trained(tmp_path, design=design), {"NEAR": 0, "WITHIN": 0}
    for batch in learner.batches(300):
        for b, k in np.ndindex(batch.program.shape):
            program = learner.table.programs[batch.program[b, k]]
            blocks = batch.next_objects[b, 1:]
            true = learner.network.world.truth(blocks)
            rows = [learner.network.vocabulary.row[word] for word in program.words]
            named = blocks[true[:, rows].all(-1)]
            if len(named) == 1:
                distance = float(np.linalg.norm(named[0, :3].astype(np.float64)))
                holds = (
                    distance <= 0.2 if program.relation == "NEAR" else abs(distance - 0.3) <= 0.03
                )
                assert batch.reward[b, k] == (1 if holds else -1)
                checked[program.relation] += int(holds)
    assert min(checked.values()) > 0


def test_a_registered_relation_does_not_change_what_near_learns(
    design: Design, tmp_path: Path
) -> None:
    first = trained(tmp_path / "a").engine.tensors()
    again = trained(tmp_path / "b", design=design.with_relations("NEAR")).engine.tensors()
    assert first.keys() == again.keys() and not any("relation" in name for name in first)
    assert all(np.array_equal(first[name], again[name]) for name in first)


def test_the_command_line_trains_on_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--extension", WITHIN, "train", "--relations", "NEAR", "WITHIN", "--frames", "200"]
    assert main([*given, "--eval-every", "0", "--out", str(tmp_path / "run")]) == 0
    config = actor_config(load_policy(tmp_path / "run" / "checkpoint").architecture)
    assert config.vocabulary.relations == ("NEAR", "WITHIN")
    assert main(["eval", "--checkpoint", str(tmp_path / "run"), "--condition", "train-within",
                 "--episodes", "2"]) == 0  # fmt: skip
    assert "WITHIN(HAND, AND(" in capsys.readouterr().out
