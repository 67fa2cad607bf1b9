"""One DPG update, by hand in float64; the engine's bookkeeping."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.formulas import StraightforwardEngine
from helpers.worlds import WORDS, WORLD, dpg, random_batch
from pa_ros.language import parse
from pa_ros.learning.algorithms.dpg.builder import make_engine
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.dpg.learner import TorchDPG
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.parameters import initial_actor, initial_critic
from pa_ros.networks.slots import slot_values, target_one_hots
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
    gradient_clip=CLIP,
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


def as_float64(tensors: dict) -> dict:
    return {name: value.astype(np.float64) for name, value in tensors.items()}


def assert_close(engine: TorchDPG, prefix: str, expected: dict, tolerance: float) -> None:
    ours = engine.tensors()
    for name, value in expected.items():
        np.testing.assert_allclose(ours[f"{prefix}.{name}"], value, rtol=0, atol=tolerance)


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


class HandMlp:
    """The canonical networks in NumPy, with the chain rule written out."""

    def __init__(self, tensors: dict) -> None:
        self.w = tensors

    def layer(self, name: str, x: np.ndarray) -> np.ndarray:
        return x @ self.w[f"{name}.weight"].T + self.w[f"{name}.bias"]

    def forward(self, x: np.ndarray, action: np.ndarray | None = None) -> np.ndarray:
        """Rows of [B, D]; keeps what `backward` needs."""
        self.x, self.first = x, np.tanh(self.layer("layers.0", x))
        second_in = self.first if action is None else np.concatenate([self.first, action], 1)
        self.second_in, self.second = second_in, np.tanh(self.layer("layers.1", second_in))
        return self.layer("output", self.second)

    def backward(self, d_out: np.ndarray) -> tuple[dict, np.ndarray]:
        """Gradients of the weights, and ∂/∂action [B, 6] if there is one."""
        gradients = {"output.weight": d_out.T @ self.second, "output.bias": d_out.sum(0)}
        d_second = d_out @ self.w["output.weight"] * (1 - self.second**2)
        gradients |= {
            "layers.1.weight": d_second.T @ self.second_in,
            "layers.1.bias": d_second.sum(0),
        }
        d_in = d_second @ self.w["layers.1.weight"]
        hidden = self.first.shape[1]
        d_first = d_in[:, :hidden] * (1 - self.first**2)
        gradients |= {"layers.0.weight": d_first.T @ self.x, "layers.0.bias": d_first.sum(0)}
        return gradients, d_in[:, hidden:]


def flattened(objects: np.ndarray, arm: np.ndarray, program: np.ndarray) -> np.ndarray:
    """Inputs of the canonical networks, one row per transition and program."""
    shapes, colors = np.eye(16)[:, slot_values(WORLD).T + [[7], [11]]].transpose(1, 0, 2)
    rows = []
    for b, k in np.ndindex(program.shape):
        fills = (objects[b] @ shapes) * (objects[b] @ colors)
        scaled = objects[b].astype(np.float64) * np.array([5.0] * 3 + [1.0] * 13)
        target = target_one_hots(parse(TEXTS[program[b, k]], WORDS), WORDS)
        rows.append(np.concatenate([scaled[0], (fills.T @ scaled).ravel(), arm[b], target]))
    return np.array(rows, np.float64)


def test_one_update_by_hand() -> None:
    """The whole update in float64 NumPy: target, both gradients, clip, Adam."""
    network = NetworkConfig(world=WORLD, family="canonical", canonical_hidden=10)
    actor, critic = networks(network)
    actor["output.weight"] *= 100.0
    critic["output.weight"] *= 30.0
    engine = TorchDPG(network, CONFIG, table(TEXTS[:2]), actor, critic)
    batch = random_batch(np.random.default_rng(3), 5, 2, 2)
    engine.update(batch)

    pi, q = HandMlp(as_float64(actor)), HandMlp(as_float64(critic))
    count = batch.program.size
    after = flattened(batch.next_objects, batch.next_arm, batch.program)
    now = flattened(batch.objects, batch.arm, batch.program)
    bootstrap = q.forward(after, np.tanh(pi.forward(after)))
    discount = np.repeat(batch.discount.astype(np.float64), 2)[:, None]
    target = batch.reward.astype(np.float64).reshape(-1, 1) + discount * bootstrap
    taken = np.repeat(batch.action.astype(np.float64), 2, axis=0)
    error = q.forward(now, taken) - target
    critic_gradient, _ = q.backward(2 * error / count)
    action = np.tanh(pi.forward(now))
    q.forward(now, action)
    _, slope = q.backward(np.ones((count, 1)))
    assert 0.1 < (np.abs(slope) > CLIP).mean() < 0.9
    ascent = np.clip(slope, -CLIP, CLIP)
    actor_gradient, _ = pi.backward(-ascent / count * (1 - action**2))
    for name, tensors, gradient, rate in (
        ("actor", pi.w, actor_gradient, 1e-3),
        ("critic", q.w, critic_gradient, 2e-3),
    ):
        expected = {
            key: tensors[key] - rate * g / (np.sqrt(g * g) + 1e-8) for key, g in gradient.items()
        }  # Adam's first step: both bias-corrected moments are the gradient's own
        assert_close(engine, name, expected, 1e-10)
    assert engine.metrics()["critic_loss"] == pytest.approx(float((error**2).mean()), rel=1e-12)
    assert engine.metrics()["mean_q"] == pytest.approx(float((error + target).mean()), rel=1e-10)
    norm = np.sqrt(sum((g * g).sum() for g in actor_gradient.values()))
    assert engine.metrics()["actor_gradient_norm"] == pytest.approx(norm, rel=1e-10)


def made(config: DPGConfig = CONFIG, kind: str = "programmable") -> TorchDPG:
    network = NetworkConfig(world=WORLD, family=kind, hidden=8, attention=5)
    engine = make_engine(network, config, table(), np.random.default_rng(4))
    assert isinstance(engine, TorchDPG)
    return engine


def test_targets_move_only_when_copied() -> None:
    engine = made()
    start = engine.tensors()
    rng = np.random.default_rng(0)
    engine.update(random_batch(rng, 4, 1, 3))
    after = engine.tensors()
    for name in (n for n in start if n.startswith("target_")):
        np.testing.assert_array_equal(after[name], start[name])
        source = name.removeprefix("target_")
        np.testing.assert_array_equal(start[name], start[source])
    engine.end_episode()
    copied = engine.tensors()
    for name in (n for n in start if n.startswith("target_")):
        np.testing.assert_array_equal(copied[name], after[name.removeprefix("target_")])
    assert not np.array_equal(after["actor.output.bias"], start["actor.output.bias"])


def test_tensors_are_all_there_is() -> None:
    """A second engine with the first's tensors goes on identically."""
    first, second = made(), made(kind="programmable")
    rng = np.random.default_rng(0)
    batches = [random_batch(rng, 4, 2, 3) for _ in range(6)]
    for batch in batches[:3]:
        first.update(batch)
    second.load_tensors(first.tensors())
    for batch in batches[3:]:
        first.update(batch)
        second.update(batch)
    theirs = second.tensors()
    for name, value in first.tensors().items():
        np.testing.assert_array_equal(value, theirs[name])


def test_tensors_that_do_not_fit_are_refused() -> None:
    engine = made()
    tensors = engine.tensors()
    with pytest.raises(NetworkError, match="actor.output.bias: expected .6,., got .7,."):
        engine.load_tensors(tensors | {"actor.output.bias": np.zeros(7)})
    with pytest.raises(NetworkError, match=r"missing \['adam.actor.step'\]"):
        engine.load_tensors({k: v for k, v in tensors.items() if k != "adam.actor.step"})


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
