"""The fused update against formulas in float64 autograd, written out as docs/DESIGN.md has them."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from pa_ros.core.errors import ConfigError
from pa_ros.language import parse
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.learning import fused_library
from pa_ros.learning.backend import HAND_INDEX, Batch, make_backend
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.dpg import TorchBackend
from pa_ros.learning.fused import FusedActor, FusedBackend, FusedError, fused_available, why_not
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import (
    TensorError,
    Tensors,
    initial_actor,
    initial_critic,
    truth_matrix,
)
from pa_ros.networks.programs import ProgramTable
from pa_ros.networks.relevance import program_tensors, relevant_objects

PROGRAMS = (
    "NEAR(HAND, RED)",
    "NEAR(HAND, AND(RED, CUBE))",
    "NEAR(HAND, OR(BLUE, SPHERE))",
    "NEAR(HAND, NOT(GREEN))",
    "NEAR(HAND, AND(CUBE, SPHERE, RED, NOT(CYLINDER)))",
    "NEAR(HAND, OR(AND(NOT(OR(AND(RED, CUBE), BLUE)), SPHERE), NOT(AND(A, OR(C, GREEN)))))",
)
VOCABULARY = Vocabulary(("CUBE", "SPHERE", "CYLINDER", "C"), ("RED", "GREEN", "BLUE", "A", "B"))
SMALL = Vocabulary(("CUBE", "SPHERE"), ("RED", "BLUE"))
Named = dict[str, Tensor]


@dataclass
class Setting:
    """A learner's networks, configuration, programs and initial tensors."""

    network: NetworkConfig
    config: LearnerConfig
    table: ProgramTable
    actor: Tensors
    critic: Tensors

    def backend(self, **changes: object) -> FusedBackend:
        config = replace(self.config, **changes)  # type: ignore[arg-type]
        return FusedBackend(self.network, config, self.table, self.actor, self.critic)


def setting(
    kind: str = "programmable",
    scale: float = 1.0,
    vocabulary: Vocabulary = VOCABULARY,
    **sizes: float,
) -> Setting:
    """Random networks; `scale` multiplies the detectors: large, and p is near 0 and 1."""
    network = NetworkConfig(vocabulary, kind=kind, actor_output_scale=0.3, **sizes)  # type: ignore[arg-type]
    table = ProgramTable(vocabulary)
    words = set(vocabulary.words)
    for text in PROGRAMS:
        program = parse(text, VOCABULARY)
        if words.issuperset(program.words):
            table.add(program)
    rng = np.random.default_rng(1)
    actor, critic = initial_actor(network, rng), initial_critic(network, rng)
    for tensors in (actor, critic):
        if "detectors.weight" in tensors:
            tensors["detectors.weight"] *= scale
    config = LearnerConfig(
        action_l2=0.02,
        action_l2_decay=0.5,
        action_l2_decay_updates=800,
        detector_gain=3.0,
        detector_decay=0.5,
        detector_decay_updates=900,
        rates_fall_after=3,
        geometry_decay=0.01,
        geometry_decay_after=2,
    )
    return Setting(network, config, table, actor, critic)


def make_batch(
    rng: np.random.Generator, size: int, objects: int, programs: int, rows: int
) -> Batch:
    """Random observations of the right kind: a hand and blocks with one shape and one color."""

    def scene() -> np.ndarray:
        x = np.zeros((size, objects, 16), np.float32)
        x[..., :3] = rng.normal(0, 0.3, (size, objects, 3))
        x[..., 3:7] = rng.normal(0, 0.5, (size, objects, 4))
        shape, color = (rng.integers(0, n, (size, objects)) for n in (4, 5))
        np.put_along_axis(x, 7 + shape[..., None], 1.0, -1)
        np.put_along_axis(x, 11 + color[..., None], 1.0, -1)
        x[:, HAND_INDEX] = 0
        x[:, HAND_INDEX, 6] = 1
        return x

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    discount = np.where(rng.random(size) < 0.1, 0, 0.99).astype(np.float32)
    return Batch(
        objects=scene(),
        arm=normal(size, 18),
        action=rng.uniform(-1, 1, (size, 6)).astype(np.float32),
        next_objects=scene(),
        next_arm=normal(size, 18),
        program=rng.integers(0, rows, (size, programs)).astype(np.int32),
        reward=rng.choice([-1.0, 1.0], (size, programs)).astype(np.float32),
        discount=discount,
    )


class Reference:
    """DPG by autograd in float64: every pair of objects through r, as the paper writes it."""

    def __init__(self, made: Setting) -> None:
        self.made = made
        self.actor, self.critic = _doubles(made.actor), _doubles(made.critic)
        self.target_actor, self.target_critic = _doubles(made.actor), _doubles(made.critic)
        self.codes = program_tensors(made.table)
        self.truth = torch.tensor(truth_matrix(made.network.vocabulary), dtype=torch.float64)
        rates = ((self.actor, made.config.actor_rate), (self.critic, made.config.critic_rate))
        gain, self.updates = made.config.detector_gain, 0
        self.adams = [
            torch.optim.Adam(
                [
                    {"params": v, "initial": rate * (gain if k.startswith("detectors.") else 1.0)}
                    for k, v in tensors.items()
                ]
            )
            for tensors, rate in rates
        ]

    def h(self, t: Named, objects: Tensor, arm: Tensor, program: Tensor) -> Tensor:
        """[B, K, H]."""
        batch, n = objects.shape[:2]
        scale = torch.ones(16, dtype=torch.float64)
        scale[:3] = self.made.network.position_scale
        columns = torch.cat([objects * scale, arm[:, None].expand(-1, n, -1)], -1)  # [B, N, 34]
        phi = self.phi(t, objects, columns)
        p = relevant_objects(phi, HAND_INDEX, *(code[program] for code in self.codes))  # [B, K, N]
        q, c = _linear(t, "query", columns), _linear(t, "context", columns)
        scores = torch.tanh(q[:, :, None] + c[:, None, :]) @ t["attention.weight"]  # [B, i, j]
        heard = torch.exp(scores)
        own = torch.eye(n, dtype=torch.float64)
        heard = heard * (1 - own * (1 - self.made.network.self_weight))
        alpha = p[:, :, None, :] * heard[:, None]  # [B, K, i, j]
        alpha = alpha / alpha.sum(-1, keepdim=True).clamp_min(1e-30)
        pairs = torch.cat(
            [
                columns[:, :, None].expand(batch, n, n, 34),
                columns[:, None, :].expand(batch, n, n, 34),
            ],
            -1,
        )
        r = _linear(t, "message.1", torch.tanh(_linear(t, "message.0", pairs)))  # [B, i, j, H]
        f = _linear(t, "local.1", torch.tanh(_linear(t, "local.0", columns)))  # [B, i, H]
        omega = f[:, None] + torch.einsum("bkij,bijh->bkih", alpha, r)
        # of an r that hears nothing, its last bias remains
        omega = omega + (1 - alpha.sum(-1, keepdim=True)) * t["message.1.bias"]
        return torch.einsum("bki,bkih->bkh", p, omega)

    def phi(self, t: Named, objects: Tensor, columns: Tensor) -> Tensor:
        """[B, V, N]."""
        if "detectors.weight" not in t:
            return (objects @ self.truth).transpose(1, 2)
        logits = _linear(t, "detectors", columns)
        groups = logits.split(self.made.network.vocabulary.group_sizes, dim=-1)
        return torch.cat([g.softmax(-1) for g in groups], -1).transpose(1, 2)

    def act(self, t: Named, objects: Tensor, arm: Tensor, program: Tensor) -> Tensor:
        return torch.tanh(_linear(t, "output", torch.tanh(self.h(t, objects, arm, program))))

    def value(self, t: Named, h: Tensor, action: Tensor) -> Tensor:
        return _linear(t, "output", torch.tanh(h + _linear(t, "action", action))).squeeze(-1)

    def gradients(self, batch: Batch) -> tuple[dict[str, np.ndarray], float]:
        """Sets and returns the gradients of both networks, and the critic's loss."""
        b = {
            name: torch.tensor(getattr(batch, name), dtype=torch.float64)
            for name in Batch.__dataclass_fields__
            if name != "program"
        }
        program = torch.tensor(batch.program, dtype=torch.int64)
        seen, after = (b["objects"], b["arm"], program), (b["next_objects"], b["next_arm"], program)
        with torch.no_grad():
            action = self.act(self.target_actor, *after)
            bootstrap = self.value(self.target_critic, self.h(self.target_critic, *after), action)
            target = b["reward"] + b["discount"][:, None] * bootstrap
        h = self.h(self.critic, *seen)
        loss = ((target - self.value(self.critic, h, b["action"][:, None])) ** 2).mean()
        policy = self.act(self.actor, *seen)
        leaf = policy.detach().requires_grad_()
        (slope,) = torch.autograd.grad(self.value(self.critic, h.detach(), leaf).sum(), leaf)
        for tensor in (*self.actor.values(), *self.critic.values()):
            tensor.grad = None
        loss.backward()
        clip = self.made.config.action_gradient_clip
        price = self.made.config.action_l2_after(self.updates)
        ascent = slope.clamp(-clip, clip) - price * leaf.detach()
        policy.backward(-ascent / target.numel())
        both = {"actor": self.actor, "critic": self.critic}
        return (
            {f"{o}.{k}": v.grad.numpy() for o, t in both.items() for k, v in t.items()},
            float(loss.detach()),
        )

    def update(self, batch: Batch) -> None:
        self.gradients(batch)
        share = min(1.0, self.made.config.rates_fall_after / max(self.updates, 1))
        self.decay(share)
        for adam in self.adams:
            for group in adam.param_groups:
                group["lr"] = group["initial"] * share
            adam.step()
        self.updates += 1
        self.forget_geometry()

    def forget_geometry(self) -> None:
        c = self.made.config
        for named in (self.actor, self.critic):
            if "detectors.weight" in named and self.updates > c.geometry_decay_after:
                for columns in (slice(0, 7), slice(16, 34)):  # all but the one-hots
                    named["detectors.weight"].data[:, columns] *= 1.0 - c.geometry_decay

    def decay(self, share: float) -> None:
        c = self.made.config
        left = max(0.0, 1.0 - self.updates / c.detector_decay_updates)
        for named, rate in ((self.actor, c.actor_rate), (self.critic, c.critic_rate)):
            if "detectors.weight" in named:
                kept = 1.0 - rate * share * c.detector_gain * c.detector_decay * left
                named["detectors.weight"].data.mul_(kept)

    def copy_targets(self) -> None:
        for own, target in ((self.actor, self.target_actor), (self.critic, self.target_critic)):
            for name, tensor in own.items():
                target[name].data.copy_(tensor.data)


def _doubles(tensors: Tensors) -> Named:
    return {k: torch.tensor(v, dtype=torch.float64, requires_grad=True) for k, v in tensors.items()}


def _linear(t: Named, name: str, x: Tensor) -> Tensor:
    return x @ t[f"{name}.weight"].T + t[f"{name}.bias"]


def assert_close(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray], bound: float) -> None:
    """Each tensor's largest error, against its largest element or float32's unit of the largest."""
    assert ours.keys() == theirs.keys()
    unit = {
        owner: 2**-23 * max(np.abs(x).max() for name, x in theirs.items() if name.startswith(owner))
        for owner in ("actor", "critic")
    }
    for name, tensor in theirs.items():
        error, size = np.abs(ours[name] - tensor).max(), np.abs(tensor).max()
        assert error <= bound * size + unit[name.partition(".")[0]], (name, error, size)


def check_gradients(made: Setting, batch: Batch, **changes: object) -> None:
    backend, reference = made.backend(**changes), Reference(made)
    backend.update(batch)
    expected, loss = reference.gradients(batch)
    assert_close(backend.gradients(), expected, 1e-5)
    assert backend.metrics()["critic_loss"] == pytest.approx(loss, rel=1e-5)
    squares = [np.square(g).sum() for name, g in expected.items() if name.startswith("actor.")]
    norm = backend.metrics()["actor_gradient_norm"]
    assert norm == pytest.approx(np.sqrt(sum(squares)), rel=1e-4)


def test_the_library_was_built() -> None:
    assert fused_available() == (True, "")


def test_a_missing_or_other_library_is_a_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = setting()
    monkeypatch.setattr(fused_library, "NAME", "_absent.so")
    monkeypatch.setattr(fused_library, "library", fused_library.library.__wrapped__)
    assert not fused_available()[0]
    assert "_absent.so" in why_not(made.network, made.config)
    monkeypatch.undo()
    theirs = fused_library.INTERFACE
    monkeypatch.setattr(fused_library, "INTERFACE", -1)
    monkeypatch.setattr(fused_library, "library", fused_library.library.__wrapped__)
    with pytest.raises(FusedError, match=f"expected interface -1, got {theirs}: rebuild"):
        made.backend()


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic", "true-properties"])
@pytest.mark.parametrize("objects", range(2, 10))
def test_gradients_for_every_number_of_objects(kind: str, objects: int) -> None:
    made = setting(kind)
    batch = make_batch(np.random.default_rng(objects), 11, objects, 2, len(made.table))
    check_gradients(made, batch)


@pytest.mark.parametrize("programs", [1, 2, 3, 4, 5, 6, 7, 8, 11])
def test_gradients_for_every_number_of_programs(programs: int) -> None:
    made = setting()
    check_gradients(made, make_batch(np.random.default_rng(programs), 9, 5, programs, 6))


@pytest.mark.parametrize("kind", ["programmable", "distilled-critic"])
@pytest.mark.parametrize("weight", [0.0, 0.3])
@pytest.mark.parametrize(("objects", "programs"), [(2, 1), (3, 2), (5, 1), (9, 4)])
def test_gradients_of_little_attention_to_oneself(
    kind: str, weight: float, objects: int, programs: int
) -> None:
    made = setting(kind, self_weight=weight)
    check_gradients(made, make_batch(np.random.default_rng(objects), 8, objects, programs, 6))


@pytest.mark.parametrize("row", range(len(PROGRAMS)))
@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0, 300.0])
def test_gradients_of_each_program_with_p_near_0_and_1(row: int, scale: float) -> None:
    made = setting(scale=scale)
    batch = make_batch(np.random.default_rng(row), 8, 5, 1, 1)
    batch.program[:] = row
    check_gradients(made, batch)


@pytest.mark.parametrize(
    ("objects", "hidden", "attention", "size"), [(1, 7, 3, 1), (17, 16, 16, 5), (20, 33, 17, 3)]
)
def test_gradients_of_unusual_sizes(objects: int, hidden: int, attention: int, size: int) -> None:
    made = setting(vocabulary=SMALL, hidden=hidden, attention=attention)
    batch = make_batch(np.random.default_rng(0), size, objects, 2, len(made.table))
    check_gradients(made, batch)


def saturated(factor: float) -> Setting:
    made = setting()
    for name in ("message.0.weight", "query.weight", "context.weight"):
        made.critic[name] *= factor
    return made


def test_gradients_when_first_layers_saturate(caplog: pytest.LogCaptureFixture) -> None:
    """Sums of large numbers of opposite sign, up to about 37 each, the arm's share included."""
    check_gradients(saturated(20), make_batch(np.random.default_rng(3), 16, 4, 1, 6))
    assert not caplog.records


def test_warns_where_exponentials_end(caplog: pytest.LogCaptureFixture) -> None:
    backend = saturated(150).backend()
    for seed in range(2):
        backend.update(make_batch(np.random.default_rng(seed), 16, 4, 1, 6))
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert np.isfinite(backend.tensors()["critic.message.0.weight"]).all()


def test_thousand_updates_stay_with_float64() -> None:
    made = setting(vocabulary=SMALL)
    backend, reference = made.backend(), Reference(made)
    rng = np.random.default_rng(5)
    batches = [make_batch(rng, 16, 4, 1, len(made.table)) for _ in range(20)]
    for step in range(1000):
        backend.update(batches[step % len(batches)])
        reference.update(batches[step % len(batches)])
        if step % 100 == 99:
            backend.copy_targets()
            reference.copy_targets()
    ours = backend.tensors()
    for owner, tensors in (("actor", reference.actor), ("critic", reference.critic)):
        for name, tensor in tensors.items():
            expected = tensor.detach().numpy()
            error = np.linalg.norm(ours[f"{owner}.{name}"] - expected)
            assert error <= 1e-4 * np.linalg.norm(expected), (owner, name)


def test_same_inputs_same_bits_and_instances_do_not_interfere() -> None:
    made = setting()
    rng = np.random.default_rng(2)
    batches = [make_batch(rng, 64, 5, 2, 6) for _ in range(3)]
    alone = made.backend()
    for batch in batches:
        alone.update(batch)
    first, other = made.backend(), setting("distilled-critic", scale=3).backend()
    for batch in batches:
        first.update(batch)
        other.update(make_batch(rng, 7, 3, 1, 6))
    expected = alone.tensors()
    for name, tensor in first.tensors().items():
        np.testing.assert_array_equal(tensor, expected[name], err_msg=name)
    assert not np.array_equal(other.tensors()["actor.query.weight"], expected["actor.query.weight"])


def test_state_survives_a_round_trip() -> None:
    made = setting()
    rng = np.random.default_rng(4)
    batches = [make_batch(rng, 12, 5, 1, 6) for _ in range(4)]
    whole, before, after = made.backend(), made.backend(), setting(scale=2).backend()
    for batch in batches:
        whole.update(batch)
    for batch in batches[:2]:
        before.update(batch)
    before.copy_targets()
    whole.copy_targets()
    state = before.tensors()
    assert state["adam.actor.step"] == 2
    after.load_tensors(state)
    for batch in batches[2:]:
        before.update(batch)
        after.update(batch)
    for name, tensor in before.tensors().items():
        np.testing.assert_array_equal(after.tensors()[name], tensor, err_msg=name)
    state.pop("critic.output.bias")
    with pytest.raises(TensorError, match=r"critic\.output\.bias"):
        after.load_tensors(state)


def test_exchanges_state_with_the_torch_backend() -> None:
    made = setting(vocabulary=SMALL)
    rng = np.random.default_rng(9)
    batches = [make_batch(rng, 16, 5, 1, len(made.table)) for _ in range(3)]
    theirs = TorchBackend(made.network, made.config, made.table, made.actor, made.critic)
    ours = setting(vocabulary=SMALL, scale=2).backend()
    theirs.update(batches[0])
    ours.load_tensors(theirs.tensors())
    for batch in batches[1:]:
        ours.update(batch)
        theirs.update(batch)
    expected = theirs.tensors()
    for name, tensor in ours.tensors().items():
        np.testing.assert_allclose(tensor, expected[name], rtol=1e-3, atol=2e-5, err_msg=name)
    assert ours.tensors()["adam.critic.step"] == expected["adam.critic.step"] == 3
    theirs.load_tensors(ours.tensors())
    assert ours.metrics() == pytest.approx(theirs.metrics(), rel=1e-3)


@pytest.mark.parametrize("kind", ["programmable", "true-properties"])
def test_hidden_properties_stay_hidden_and_the_rest_learns_as_in_torch(kind: str) -> None:
    made = setting(kind, relations_see_properties=False)
    ours = made.backend()
    config = replace(made.config, backend="torch", dtype="float64")
    theirs = TorchBackend(made.network, config, made.table, made.actor, made.critic)
    rng = np.random.default_rng(5)
    for _ in range(5):
        batch = make_batch(rng, 16, 5, 2, len(made.table))
        ours.update(batch)
        theirs.update(batch)
    expected = theirs.tensors()
    for name, tensor in ours.tensors().items():
        np.testing.assert_allclose(tensor, expected[name], rtol=1e-3, atol=2e-6, err_msg=name)
    properties = np.r_[7:16]
    for name in ("query", "context", "local.0", "message.0"):
        for network in ("actor", "critic"):
            weight = ours.tensors()[f"{network}.{name}.weight"]
            columns = weight.reshape(len(weight), -1, 34)
            assert not columns[..., properties].any() and columns[..., :7].all()


def test_targets_change_only_when_copied() -> None:
    made = setting()
    backend = made.backend()
    backend.update(make_batch(np.random.default_rng(0), 8, 5, 1, 6))
    kept = backend.tensors()
    np.testing.assert_array_equal(kept["target_critic.output.weight"], made.critic["output.weight"])
    assert not np.array_equal(kept["critic.output.weight"], made.critic["output.weight"])
    backend.copy_targets()
    copied = backend.tensors()["target_critic.output.weight"]
    np.testing.assert_array_equal(copied, kept["critic.output.weight"])


@pytest.mark.parametrize("size", [1, 5, 64])
def test_threads_change_only_rounding(size: int) -> None:
    made = setting()
    check_gradients(made, make_batch(np.random.default_rng(6), size, 5, 2, 6), threads=2)


def test_sizes_may_change_between_updates() -> None:
    made = setting()
    backend = made.backend()
    rng = np.random.default_rng(8)
    backend.update(make_batch(rng, 8, 5, 1, 6))
    for size, objects, programs in ((4, 5, 1), (64, 5, 1), (8, 3, 2)):
        backend.load_tensors(made.backend().tensors())
        batch = make_batch(rng, size, objects, programs, 6)
        backend.update(batch)
        assert_close(backend.gradients(), Reference(made).gradients(batch)[0], 1e-5)


def test_nan_is_not_hidden() -> None:
    made = setting()
    backend = made.backend()
    batch = make_batch(np.random.default_rng(0), 8, 5, 1, 6)
    batch.objects[3, 2, 1] = np.nan
    backend.update(batch)
    assert np.isnan(backend.metrics()["critic_loss"])
    assert np.isnan(backend.tensors()["actor.message.0.weight"]).any()


@pytest.mark.parametrize("kind", ["programmable", "true-properties"])
@pytest.mark.parametrize(("hand", "self_weight"), [(0, 1.0), (2, 0.3), (2, 0.0)])
def test_actor_equals_the_formulas(kind: str, hand: int, self_weight: float) -> None:
    made = setting(kind, self_weight=self_weight)
    actor, reference = FusedActor(made.network, made.actor), Reference(made)
    for objects in (5, 3):
        batch = make_batch(np.random.default_rng(objects), 1, objects, 1, 6)
        order = np.roll(np.arange(objects), hand)  # the hand at its index; the rest in any order
        for row, text in enumerate(PROGRAMS):
            seen = torch.tensor(batch.objects).double(), torch.tensor(batch.arm).double()
            expected = reference.act(reference.actor, *seen, torch.tensor([[row]]))
            turned = batch.objects[0][order]
            ours = actor.act(
                turned, batch.arm[0], parse(text, VOCABULARY), int(np.flatnonzero(order == 0)[0])
            )
            np.testing.assert_allclose(ours, expected[0, 0].detach(), rtol=0, atol=2e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"arm": np.zeros((8, 17), np.float32)}, r"arm: expected contiguous float32 \(8, 18\)"),
        ({"reward": np.zeros((8, 1))}, "reward: expected contiguous float32"),
        ({"program": np.full((8, 1), 6, np.int32)}, "expected programs below 6, got 6"),
        ({"program": np.zeros(8, np.int32)}, r"program \[B, K\]"),
    ],
)
def test_refuses_batches_that_do_not_fit(change: dict[str, np.ndarray], message: str) -> None:
    batch = replace(make_batch(np.random.default_rng(0), 8, 5, 1, 6), **change)
    with pytest.raises(FusedError, match=message):
        setting().backend().update(batch)


def test_is_chosen_where_it_applies() -> None:
    made = setting()
    for choice, name in (("auto", "fused"), ("fused", "fused"), ("torch", "torch")):
        config = replace(made.config, backend=choice)
        assert make_backend(made.network, config, made.table, np.random.default_rng()).name == name


def test_says_why_it_does_not_apply() -> None:
    config, network = LearnerConfig(), setting().network
    assert why_not(network, config) == ""
    assert why_not(replace(network, kind="canonical"), config) == ""
    words = Vocabulary(("CUBE",), tuple(f"COLOR{i}" for i in range(fused_library.MAX_WORDS)))
    assert "words" in why_not(replace(network, vocabulary=words), config)
    assert "float64" in why_not(network, replace(config, dtype="float64"))
    assert "cuda" in why_not(network, replace(config, device="cuda"))
    with pytest.raises(FusedError, match="cuda"):
        setting().backend(device="cuda")
    assert not isinstance(FusedError("x"), ConfigError)


@pytest.mark.parametrize("level", ["x86-64-v3", "generic"])
def test_narrower_instruction_sets_agree(level: str) -> None:
    """The same gradient tests in a process that is told to use fewer instructions."""
    probe = "from pa_ros.learning import fused_library; print(fused_library.level())"
    environment = os.environ | {"PA_ROS_FUSED_LEVEL": level}
    used = subprocess.run(
        [sys.executable, "-c", probe], env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()
    assert used == level or used == "generic"
    if used == fused_library.level():
        return  # this process ran them
    chosen = "number_of_programs or number_of_objects or unusual_sizes or saturate or actor_equals"
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", __file__]
    canonical = str(Path(__file__).with_name("test_fused_canonical.py"))
    command += [canonical, "-k", f"{chosen} or canonical and gradients"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout[-3000:]
