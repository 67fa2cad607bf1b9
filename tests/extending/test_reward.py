"""The example of a reward is chosen by name and used in relabeling."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.learners import load_example, trained
from pa_ros.core.errors import ConfigError
from pa_ros.learning.checkpoints import restore
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.folder import checkpoint_of
from pa_ros.learning.learner import Learner
from pa_ros.world import Sparse, reward_from
from pa_ros.world.reward import REWARDS

SHAPED = '{"name": "shaped", "weight": 0.8}'


def rewards_drawn(learner: Learner) -> np.ndarray:
    """Relabeled rewards of sampled batches."""
    return np.concatenate([batch.reward.ravel() for batch in learner.batches(50)])


def test_relabeled_rewards_follow_it_and_no_other_run_is_resumed_under_it(tmp_path: Path) -> None:
    load_example("reward")
    usual, shaped = trained(tmp_path / "a"), trained(tmp_path / "b", reward_from(SHAPED))
    assert set(rewards_drawn(usual)) <= {-1.0, 1.0}
    drawn = rewards_drawn(shaped)
    away = drawn[drawn < 1.0]
    assert len(np.unique(away)) > 100  # a number for every distance
    assert away.min() > -1.0 and away.max() < -1.0 + 0.8 * np.exp(-0.2 / 0.3) + 1e-6
    ours, theirs = (one.snapshot().tensors["output.weight"] for one in (usual, shaped))
    assert not np.array_equal(ours, theirs)
    with pytest.raises(CheckpointError, match="scoring.*Shaped"):
        restore(checkpoint_of(tmp_path / "b"), usual)


def test_it_is_chosen_by_name_or_json() -> None:
    shaped = load_example("reward").Shaped
    assert reward_from("shaped") == shaped()
    assert reward_from(SHAPED).to_json() == '{"length_m":0.3,"name":"shaped","weight":0.8}'
    with pytest.raises(ConfigError, match=r"\['weight', 'length_m'\], got wait = 1"):
        reward_from('{"name": "shaped", "wait": 1}')


def test_an_error_of_a_reward_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True)
    class NotOfArrays(Sparse):
        def __call__(self, satisfied: Any, measure: Any) -> Any:
            return 1.0 if satisfied else -1.0

    monkeypatch.setitem(REWARDS._items, "mine", NotOfArrays)  # noqa: SLF001
    with pytest.raises(ConfigError, match="reward mine: expected a dataclass with defaults that"):
        reward_from("mine")
