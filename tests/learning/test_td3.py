"""TD3: one update by hand, its delay and targets, and all that DPG has through the same learner."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from helpers.worlds import PROGRAMS, WORLD, PointWorld, random_batch
from pa_ros.core.errors import ConfigError
from pa_ros.core.update import Batch
from pa_ros.learning.algorithms.td3.builder import make_engine
from pa_ros.learning.algorithms.td3.config import CRITICS, TD3Config
from pa_ros.learning.algorithms.td3.learner import SMOOTHING_STREAM, TorchTD3
from pa_ros.learning.checkpoints import read_metadata
from pa_ros.learning.config import LearnerConfig, TrainConfig
from pa_ros.learning.folder import checkpoint_of
from pa_ros.learning.learner import Learner
from pa_ros.learning.loop import train
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.programs import ProgramTable

NETWORK = NetworkConfig(world=WORLD, family="true-properties", hidden=6, attention=4)
CONFIG = TD3Config().changed(**{"engine.dtype": "float64", "targets.tau": 0.25})
LEARNS = TD3Config().changed(
    **{
        "replay.batch_size": 4,
        "replay.warmup_frames": 30,
        "schedule.trajectory_steps": 20,
        "relabeling.rule": "all-goals",
    }
)


def made(config: TD3Config = CONFIG) -> TorchTD3:
    table = ProgramTable(WORLD.vocabulary)
    for program in PROGRAMS:
        table.add(program)
    engine = make_engine(NETWORK, config, table, np.random.default_rng(4))
    assert isinstance(engine, TorchTD3)
    return engine


def q_of(engine: TorchTD3, critic: Any, batch: Batch, action: np.ndarray, then: bool) -> np.ndarray:
    """Of one critic, or of a target, as its module computes it, [B]."""
    objects, arm = (batch.next_objects, batch.next_arm) if then else (batch.objects, batch.arm)
    seen = [torch.from_numpy(x).double() for x in (objects, arm)]
    with torch.no_grad():
        q = critic(*seen, engine.programs(batch.program), torch.from_numpy(action).double())
    return np.asarray(q[:, 0])


def test_the_target_is_of_the_lesser_critic_at_a_clipped_noisy_action() -> None:
    """With σ far above the clip every noise is ±clip, and with clip 0 there is none."""
    batch = random_batch(np.random.default_rng(0), 6, 1, 2)
    losses = []
    for clip in (0.0, 0.3, 1.5):  # at 1.5 most actions would leave [-1, 1]
        engine = made(CONFIG.changed(**{"smoothing.sigma": 1e6, "smoothing.clip": clip}))
        expected = by_hand(engine, batch, clip)
        engine.update(batch)
        assert engine.metrics()["critic_loss"] == pytest.approx(expected, rel=1e-9)
        losses.append(expected)
    assert len(set(losses)) == 3


def by_hand(engine: TorchTD3, batch: Batch, clip: float) -> float:
    """Mean of both critics' losses before an update."""
    seen = [torch.from_numpy(x).double() for x in (batch.next_objects, batch.next_arm)]
    with torch.no_grad():
        action = engine.targets["actor"](*seen, engine.programs(batch.program))[:, 0].numpy()
    drawn = np.random.default_rng([SMOOTHING_STREAM, 0]).normal(size=(6, 1, 6))[:, 0]
    action = np.clip(action + clip * np.sign(drawn), -1, 1)
    both = [q_of(engine, engine.targets[name], batch, action, True) for name in CRITICS]
    target = batch.reward[:, 0] + batch.discount * np.minimum(*both)
    errors = [
        q_of(engine, engine.networks[name], batch, batch.action, False) - target for name in CRITICS
    ]
    return float(np.mean([np.square(error).mean() for error in errors]))


def test_actor_and_targets_move_at_every_second_update_and_targets_a_share() -> None:
    engine = made()
    start = engine.tensors()
    rng = np.random.default_rng(0)
    engine.update(random_batch(rng, 4, 1, 2))
    once = engine.tensors()
    assert engine.metrics()["actor_gradient_norm"] == 0.0
    assert moved(start, once) == {"critic_1", "critic_2"}
    engine.update(random_batch(rng, 4, 1, 2))
    twice = engine.tensors()
    names = {"actor", "critic_1", "critic_2"}
    assert moved(once, twice) == names | {f"target_{name}" for name in names}
    for name in ("actor.output.weight", "critic_2.output.weight"):
        between = 0.75 * once[f"target_{name}"] + 0.25 * twice[name]
        np.testing.assert_allclose(twice[f"target_{name}"], between, rtol=1e-12)
    engine.end_episode()
    assert not moved(twice, engine.tensors())


def test_all_rates_halve_with_the_updates_of_the_critics() -> None:
    engine = made(CONFIG.changed(**{"optimizer.half_life": 2.0}))
    for _ in range(5):
        engine.update(random_batch(np.random.default_rng(0), 4, 1, 2))
    for adam in engine._adams.values():  # noqa: SLF001
        assert [group["lr"] / group["initial_lr"] for group in adam.param_groups] == [0.25]


def moved(before: dict, after: dict) -> set[str]:
    """Networks of which any weight differs."""
    weights = [name for name in before if not name.startswith("adam.")]
    return {n.partition(".")[0] for n in weights if not np.array_equal(before[n], after[n])}


def test_the_fused_engine_is_rejected() -> None:
    with pytest.raises(ConfigError, match="got 'fused': td3 is computed by torch alone"):
        made(CONFIG.changed(**{"engine.name": "fused"}))


def run(out: Path, frames: int, config: LearnerConfig = LEARNS, resume: bool = False) -> Learner:
    asked = TrainConfig(out=out, seed=3, frames=frames)
    return train(asked, NETWORK, config, PointWorld(3), np.ones(6), PROGRAMS, None, resume)


def test_a_resumed_run_ends_where_an_unbroken_one_does(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", 120)
    run(tmp_path / "parts", 60)
    parts = run(tmp_path / "parts", 120, resume=True)
    theirs = parts.engine.tensors()
    assert whole.counters.updates == 100
    for name, tensor in whole.engine.tensors().items():
        np.testing.assert_array_equal(tensor, theirs[name], err_msg=name)
    assert read_metadata(checkpoint_of(tmp_path / "whole"))["algorithm"] == "td3"
