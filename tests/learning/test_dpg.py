"""One DPG update, by hand in float64; the engine's bookkeeping."""

import numpy as np
import pytest

from helpers.formulas import StraightforwardEngine
from helpers.worlds import WORDS, WORLD, dpg, random_batch
from pa_ros.language import parse
from pa_ros.learning.algorithms.dpg.builder import make_engine
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.dpg.learner import TorchDPG
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import initial_actor, initial_critic
from pa_ros.world.programs import ProgramTable

TEXTS = ("NEAR(HAND, AND(RED, CUBE))", "NEAR(HAND, AND(BLUE, SPHERE))", "NEAR(HAND, OR(RED, BLUE))")
CLIP = 0.02  # small, so that some of ∂Q/∂a is clipped and some is not
GAIN = 3.0
SPARSITY = 0.4
CONFIG = dpg(
    engine__name="torch",
    engine__dtype="float64",
    optimizer__actor_rate=1e-3,
    optimizer__critic_rate=2e-3,
    optimizer__half_life=2.0,
    gradient_clip=CLIP,
    action_penalty=0.01,
    detectors__gain=GAIN,
    detectors__sparsity=SPARSITY,
    detectors__free_from=0.1,
)


def table(texts=TEXTS) -> ProgramTable:
    made = ProgramTable(WORDS)
    for text in texts:
        made.add(parse(text, WORDS))
    return made


def networks(config: NetworkConfig) -> tuple[dict, dict]:
    rng = np.random.default_rng(0)
    actor, critic = initial_actor(config, rng), initial_critic(config, rng)
    for tensors in (actor, critic):
        for tensor in tensors.values():
            tensor *= 2.0
    return actor, critic


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize("see", [True, False])
@pytest.mark.parametrize("biased", [True, False])
def test_updates_agree_with_the_formulas_as_they_stand(kind, k, see, biased) -> None:
    """Five updates with a target copy between: formulas, clipping and Adam written out."""
    network = NetworkConfig(
        world=WORLD,
        family=kind,
        hidden=8,
        attention=5,
        actor_output_scale=0.5,
        relations_see_properties=see,
        detectors_have_biases=biased,
    )
    given = network, CONFIG, table(), *networks(network)
    engine, expected = TorchDPG(*given), StraightforwardEngine(*given)
    rng = np.random.default_rng(1)
    for made in range(5):
        if made == 3:
            engine.end_episode()
            expected.end_episode()
        batch = random_batch(rng, 4, k, len(TEXTS))
        for one in (engine, expected):
            one.update(batch)
        assert engine.metrics()["critic_loss"] == pytest.approx(expected.loss, rel=1e-9)
    ours = engine.tensors()
    assert ours.pop("adam.actor.step") == ours.pop("adam.critic.step") == 5
    assert ours.keys() == expected.tensors().keys()
    for name, tensor in expected.tensors().items():
        np.testing.assert_allclose(ours[name], tensor, rtol=0, atol=1e-11, err_msg=name)


def made(config: DPGConfig = CONFIG, kind: str = "programmable") -> TorchDPG:
    network = NetworkConfig(world=WORLD, family=kind, hidden=8, attention=5)
    engine = make_engine(network, config, table(), np.random.default_rng(4))
    assert isinstance(engine, TorchDPG)
    return engine


def test_actor_tensors_are_owned_float32() -> None:
    engine = made()
    tensors = engine.actor_tensors()
    assert {t.dtype for t in tensors.values()} == {np.dtype(np.float32)}
    before = tensors["output.bias"].copy()
    engine.update(random_batch(np.random.default_rng(0), 4, 1, 3))
    np.testing.assert_array_equal(tensors["output.bias"], before)


def test_programs_may_join_between_updates() -> None:
    network = NetworkConfig(world=WORLD, hidden=8, attention=5)
    programs = table(TEXTS[:1])
    engine = make_engine(network, CONFIG, programs, np.random.default_rng(4))
    engine.update(random_batch(np.random.default_rng(0), 4, 1, 1))
    programs.add(parse("NEAR(HAND, NOT(AND(NOT(RED), NOT(CUBE))))", WORDS))
    engine.update(random_batch(np.random.default_rng(0), 4, 3, 2))
    assert np.isfinite(engine.metrics()["critic_loss"])
