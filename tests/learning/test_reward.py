"""The arena's reward is the learner's: another one changes what relabeling teaches."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from helpers.worlds import NEAR_M, PROGRAMS, WORLD, PointWorld, dpg
from pa_ros.core.experience import Float64
from pa_ros.core.update import Batch
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.checkpoints import restore
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.errors import CheckpointError
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.networks.config import NetworkConfig
from pa_ros.world import Reward, Sparse

NETWORK = NetworkConfig(world=WORLD, hidden=6, attention=4)
SETTINGS = dpg(
    replay__batch_size=16,
    replay__capacity_frames=200,
    replay__warmup_frames=0,
    schedule__trajectory_steps=10,
    schedule__policy_lag=0,
    relabeling__rule="all-goals",
    relabeling__programs_per_transition=2,
)


@dataclass(frozen=True)
class MinusDistance(Reward):
    """A newcomer's: the distance itself, not whether it is near."""

    per_metre: float = 1.0

    def __call__(self, satisfied: NDArray[np.bool_], measure: Float64) -> Float64:
        return -self.per_metre * measure


def paid(batches: list[Batch], k: int) -> Iterator[tuple[float, float]]:
    """(distance to the block named, reward) of every drawn transition under every program.

    Rows of the table are PROGRAMS: the block named is object 1 or 2.
    """
    for batch in batches:
        assert batch.program.shape == (SETTINGS.replay.batch_size, k)
        for b, column in np.ndindex(*batch.program.shape):
            place = batch.next_objects[b, 1 + batch.program[b, column], :3]
            yield float(np.linalg.norm(place)), float(batch.reward[b, column])


def trained(out: Path, reward: Reward | None, settings: DPGConfig = SETTINGS) -> Learner:
    config = TrainConfig(out=out, seed=1, frames=400, evaluate_every_frames=0)
    world = PointWorld(reward=reward)
    return train(config, NETWORK, settings, world, np.full(6, 2.0), PROGRAMS)


CASES = [
    (None, lambda d: 1.0 if d <= NEAR_M else -1.0),
    (Sparse(2.0, -0.5), lambda d: 2.0 if d <= NEAR_M else -0.5),
    (MinusDistance(3.0), lambda d: -3.0 * d),
]


@pytest.mark.parametrize(("reward", "rule"), CASES, ids=["plus-minus-one", "sparse", "dense"])
def test_relabeled_batches_follow_the_arenas_reward(tmp_path, reward, rule) -> None:  # type: ignore[no-untyped-def]
    learner = trained(tmp_path, reward)
    seen = list(paid(list(learner.batches(120)), k=2))
    for distance, received in seen:
        assert received == pytest.approx(rule(distance), abs=1e-6)
    near = [distance <= NEAR_M for distance, _ in seen]
    assert 20 < sum(near) < len(near) - 20


def test_a_run_is_not_resumed_under_another_reward(tmp_path: Path) -> None:
    for reward in (Sparse(2.0, -0.5), MinusDistance()):
        learner = trained(tmp_path / reward.__class__.__name__, reward)
        folder = tmp_path / reward.__class__.__name__ / "checkpoint"
        same = Learner(NETWORK, SETTINGS, PROGRAMS, 1, learner.scoring)
        restore(folder, same)
        with pytest.raises(CheckpointError, match=rf"scoring.*{type(reward).__name__}"):
            restore(folder, Learner(NETWORK, SETTINGS, PROGRAMS, 1))
