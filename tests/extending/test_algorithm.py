"""The example of an algorithm learns with the usual learner."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.learners import load_example, trained
from pa_ros.core.errors import ConfigError
from pa_ros.learning.recipes import LearningSettings
from pa_ros.learning.run import LearningRun
from pa_ros.networks.torch_actor import TorchActor


def test_the_usual_learner_trains_with_it_and_announces_it(tmp_path: Path) -> None:
    crr = load_example("algorithm")
    usual, learner = trained(tmp_path / "a"), trained(tmp_path / "b", algorithm="crr")
    assert isinstance(learner.config, crr.CRRConfig)
    assert isinstance(learner.engine, crr.TorchCRR)
    assert learner.counters == usual.counters and learner.counters.updates == 200
    assert LearningRun(learner, 0.1).info.algorithm == "crr"
    ours, theirs = (one.snapshot().tensors["output.weight"] for one in (usual, learner))
    assert np.isfinite(theirs).all() and not np.array_equal(ours, theirs)
    assert learner.metrics()["critic_loss"] > 0


def test_the_actor_learns_the_rewarded_action(tmp_path: Path) -> None:
    """A bandit: one state with two stored actions, one of them rewarded."""
    load_example("algorithm")
    fast: dict[str, Any] = {
        "learner.optimizer.actor_rate": 3e-3,
        "learner.optimizer.critic_rate": 3e-3,
        "network.critic_starts_unrewarded": False,  # the values of a bandit are near 0
    }
    learner = trained(tmp_path, algorithm="crr", frames=100, **fast)
    (batch,) = learner.batches(1)
    good = np.arange(len(batch.action)) % 2 == 0
    sign = np.where(good, 1.0, -1.0).astype(np.float32)
    same = {
        name: np.repeat(getattr(batch, name)[:1], len(good), 0)
        for name in ("objects", "arm", "next_objects", "next_arm", "program")
    }
    bandit = replace(
        batch,
        **same,
        action=np.repeat(0.5 * sign[:, None], 6, 1),
        reward=np.repeat(sign[:, None], batch.program.shape[1], 1),
        discount=np.zeros_like(batch.discount),
    )
    for _ in range(400):
        learner.engine.update(bandit)
    actor = TorchActor(learner.network, learner.engine.actor_tensors())
    program = learner.table.programs[int(batch.program[0, 0])]
    action = actor.act(batch.objects[0], batch.arm[0], program, 0)
    np.testing.assert_allclose(action, 0.5, atol=0.15)


def test_its_settings_are_options_with_defaults_by_recipe() -> None:
    load_example("algorithm")
    ours = LearningSettings(algorithm="crr")
    assert ours.flat()["learner.temperature"] == 0.2
    paper = LearningSettings(recipe="paper", algorithm="crr")
    assert paper.flat()["learner.temperature"] == 0.1
    changed = ours.changed(**{"learner.temperature": 0.3})
    assert changed.flat()["learner.temperature"] == 0.3
    with pytest.raises(ConfigError, match="temperature"):
        ours.changed(**{"learner.temperature": 0})


def test_an_algorithm_sees_later_rows_and_their_rewards(tmp_path: Path) -> None:
    load_example("returns")
    settings: dict[str, Any] = {"learner.steps": 3}
    learner = trained(tmp_path, algorithm="returns", **settings)
    engine: Any = learner.engine
    seen: list[Any] = []

    def step(x: Any) -> Any:
        seen.append(x)
        return x.reward.mean(), x.reward.mean()

    engine.step = step
    (batch,) = learner.batches(1)
    engine.update(batch)
    arrays, gamma = learner.replay.arrays, learner.config.updates.discount
    assert batch.rows is not None
    for b, row in enumerate(batch.rows):
        rows = [row]
        while len(rows) < 3 and not arrays["last"][learner.replay.following(rows[-1])]:
            rows.append(learner.replay.following(rows[-1]))
        rewards = [learner.rewards(np.array([r]), batch.program[b : b + 1])[0] for r in rows]
        expected = sum(gamma**i * reward for i, reward in enumerate(rewards))
        np.testing.assert_allclose(seen[0].reward[b], expected, rtol=1e-5)
        np.testing.assert_allclose(seen[0].discount[b], gamma ** len(rows), rtol=1e-6)
    np.testing.assert_array_equal(learner.rewards(batch.rows, batch.program), batch.reward)
