"""DPG for whole batches in torch float64, as docs/DESIGN.md has it; fused updates are held to it.

`oracle` has the same formulas one sample at a time. Here every pair of objects goes through r, as
the paper writes it, gradients are autograd's, and all that changes with the updates is applied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from oracle import GEOMETRY, Named, parameters
from torch import Tensor
from updates import update

from pa_ros.core.update import HAND_INDEX, Batch
from pa_ros.language import parse
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.learning.algorithms.dpg.config import LearnerConfig
from pa_ros.native.engine import FusedEngine
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors, initial_actor, initial_critic
from pa_ros.networks.relevance import program_tensors, relevant_objects
from pa_ros.world.programs import ProgramTable
from pa_ros.world.properties import truth_matrix

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


@dataclass
class Setting:
    """A learner's networks, configuration, programs and initial tensors."""

    network: NetworkConfig
    config: LearnerConfig
    table: ProgramTable
    actor: Tensors
    critic: Tensors

    def engine(self, **changes: object) -> FusedEngine:
        config = replace(self.config, **changes)  # type: ignore[arg-type]
        return FusedEngine(self.network, config, self.table, self.actor, self.critic)


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
        self.actor, self.critic = parameters(made.actor), parameters(made.critic)
        self.target_actor, self.target_critic = parameters(made.actor), parameters(made.critic)
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
        c = self.made.config
        spent = min(1.0, self.updates / c.action_l2_decay_updates)
        price = c.action_l2 * (1.0 - c.action_l2_decay * spent)
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
                named["detectors.weight"].data[:, GEOMETRY] *= 1.0 - c.geometry_decay

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
    engine, reference = made.engine(**changes), Reference(made)
    update(engine, batch, made.config)
    expected, loss = reference.gradients(batch)
    assert_close(engine.gradients(), expected, 1e-5)
    assert engine.metrics()["critic_loss"] == pytest.approx(loss, rel=1e-5)
    squares = [np.square(g).sum() for name, g in expected.items() if name.startswith("actor.")]
    norm = engine.metrics()["actor_gradient_norm"]
    assert norm == pytest.approx(np.sqrt(sum(squares)), rel=1e-4)
