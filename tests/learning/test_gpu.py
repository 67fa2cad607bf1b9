"""Learning on a GPU gives what it gives on the CPU. Skipped where torch has none."""

import numpy as np
import pytest
import torch

from helpers import pushing, worlds
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.world import World

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
SETTINGS = {
    "engine.name": "torch",
    "engine.dtype": "float64",
    "replay.warmup_frames": 0,
    "replay.batch_size": 4,
    "relabeling.rule": "all-goals",
    "detectors.sparsity": 0.3,
    "optimizer.half_life": 10.0,
}


def learned(
    algorithm: str, device: str, world: World = worlds.WORLD, family: str = "programmable"
) -> Learner:
    """A learner after two episodes, 40 updates."""
    config = ALGORITHMS[algorithm].config().changed(**SETTINGS, **{"engine.device": device})
    moves, rng = world is pushing.PUSH, np.random.default_rng(0)
    learner = Learner(
        NetworkConfig(world=world, family=family, hidden=6, attention=4),
        config,
        pushing.PROGRAMS if moves else worlds.PROGRAMS,
        0,
        worlds.SCORING,
    )
    for sequence in range(2):
        one = (
            pushing.pushed(rng, sequence, moves=True)
            if moves
            else worlds.random_trajectory(rng, 20, sequence=sequence)
        )
        assert learner.consume(one)
    return learner


@pytest.mark.parametrize("algorithm", ["dpg", "td3"])
@pytest.mark.parametrize(
    ("world", "family"),
    [
        (worlds.WORLD, "programmable"),
        (worlds.WORLD, "distilled-critic"),
        (worlds.WORLD, "canonical"),
        (pushing.PUSH, "programmable"),
    ],
)
def test_weights_are_those_learned_on_the_cpu(algorithm: str, world: World, family: str) -> None:
    cpu, gpu = (learned(algorithm, device, world, family) for device in ("cpu", "cuda"))
    assert gpu.counters.updates == 40
    theirs = cpu.engine.tensors()
    for name, tensor in gpu.engine.tensors().items():
        difference = np.abs(tensor.astype(float) - theirs[name].astype(float))
        assert difference.max(initial=0.0) < 1e-9, name
    for name, value in cpu.engine.metrics().items():
        assert gpu.engine.metrics()[name] == pytest.approx(value, rel=1e-6)


def test_metrics_before_the_actor_first_learns() -> None:
    learner = learned("td3", "cuda")
    fresh = ALGORITHMS["td3"].make_engine(
        learner.network, learner.config, learner.table, np.random.default_rng(0)
    )
    fresh.update(next(iter(learner.batches(1))))
    assert fresh.metrics()["actor_gradient_norm"] == 0.0


def test_what_the_cpu_learned_continues_on_the_gpu() -> None:
    from_cpu, gpu = learned("dpg", "cpu").engine.tensors(), learned("dpg", "cuda").engine
    gpu.load_tensors(from_cpu)
    for name, tensor in gpu.tensors().items():
        np.testing.assert_array_equal(tensor, from_cpu[name], err_msg=name)
