"""The paper's formulas in torch, written as directly as possible: the reference of all engines.

Batched over transitions and programs, but nothing is rearranged or shared: programs are evaluated
over their trees, r is an MLP of every concatenated pair with its last layer inside the sum, the
critic is evaluated anew for each loss, gradients come from autograd and Adam is written out. It
uses nothing of `pa_ros.networks` or an engine except the names of tensors. Tests compare numbers
with it, in float64; the learner's benchmark compares speed with it, in float32.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_ros.core.update import HAND_INDEX, Batch
from pa_ros.language import HAND, PRODUCT, Expression, Logic, Program, degree
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.programs import ProgramTable

Named = dict[str, Tensor]


class Scenes(NamedTuple):
    """B scenes, each under K programs."""

    objects: Tensor  # [B, N, F]
    arm: Tensor  # [B, A]
    programs: Sequence[Program]
    row: Tensor  # [B, K], of `programs`
    hand_index: int = HAND_INDEX
    logic: Logic = PRODUCT


def parameters(tensors: Mapping[str, NDArray[Any]], dtype: torch.dtype = torch.float64) -> Named:
    """Leaves of autograd."""
    return {k: torch.tensor(v, dtype=dtype, requires_grad=True) for k, v in tensors.items()}


def linear(named: Named, layer: str, x: Tensor) -> Tensor:
    return x @ named[f"{layer}.weight"].T + named[f"{layer}.bias"]


def mlp(named: Named, name: str, x: Tensor) -> Tensor:
    return linear(named, f"{name}.1", torch.tanh(linear(named, f"{name}.0", x)))


def columns(network: NetworkConfig, seen: Scenes) -> Tensor:
    """ω, [B, N, F + A]: scaled, the arm's features appended (appendix)."""
    arms = seen.arm[:, None].expand(-1, seen.objects.shape[1], -1)
    scaled = [seen.objects[..., :3] * network.position_scale, seen.objects[..., 3:7]]
    for group in network.world.schema:
        scaled.append(_of_group(network, seen, group.name) * group.features.scale)
    return torch.cat([*scaled, arms], -1)


def _of_group(network: NetworkConfig, seen: Scenes, group: str) -> Tensor:
    return seen.objects[..., network.world.schema.slices[group]]


def properties(network: NetworkConfig, named: Named, seen: Scenes) -> Named:
    """Φ by word, each [B, N]: one softmax per group of detectors, or the true one."""
    words = network.vocabulary.words
    if "detectors.weight" not in named:
        true: Named = {word: torch.zeros_like(seen.objects[..., 0]) for word in words}
        for one in network.world.schema:
            for value in set(one.features.values) & set(network.vocabulary[one.name]):
                like = torch.tensor(one.features.prototypes[value])
                square = (_of_group(network, seen, one.name) - like).square().sum(-1)
                true[value] = (square <= one.features.tolerance**2).to(seen.objects)
        return true
    sharp = seen.logic.sharpness * linear(named, "detectors", columns(network, seen))
    logits = sharp.unbind(-1)
    exponentials = dict(zip(words, map(torch.exp, logits), strict=True))
    phi: Named = {}
    for group in network.vocabulary.groups:
        total = torch.stack([exponentials[word] for word in group.words]).sum(0)
        phi |= {word: exponentials[word] / total for word in group.words}
    return phi


def relevance(network: NetworkConfig, named: Named, seen: Scenes) -> Tensor:
    """p = OR(HAND, e) (eq. logic), [B, K, N]."""
    phi = properties(network, named, seen)
    hand = torch.zeros_like(seen.objects[..., 0])
    hand[:, seen.hand_index] = 1.0
    logic = seen.logic
    named_by = [degree(program.target, phi.__getitem__, logic) for program in seen.programs]
    p = torch.stack([logic.either(hand, e) for e in named_by], 1)  # [B, P, N]
    return p[torch.arange(len(p))[:, None], seen.row]


def roles(network: NetworkConfig, named: Named, seen: Scenes) -> tuple[Tensor, Tensor]:
    """p twice; where programs move objects, the degrees of what is moved and of the target."""
    if not network.vocabulary.moves_objects:
        p = relevance(network, named, seen)
        return p, p
    phi = properties(network, named, seen)
    hand = torch.zeros_like(seen.objects[..., 0])
    hand[:, seen.hand_index] = 1.0
    free = [1.0 - phi[word] for word in network.vocabulary.bodiless]
    body = torch.stack([torch.ones_like(hand), *free]).prod(0)

    def share(e: Expression, of: Tensor | float = 1.0) -> Tensor:
        return hand if e == HAND else degree(e, phi.__getitem__, seen.logic) * of * (1.0 - hand)

    rows = torch.arange(len(hand))[:, None], seen.row
    moved = torch.stack([share(program.moved, body) for program in seen.programs], 1)
    return moved[rows], torch.stack([share(one.target) for one in seen.programs], 1)[rows]


def trunk(network: NetworkConfig, named: Named, seen: Scenes) -> Tensor:
    """h = Σ p_i ω'_i, ω'_i = f(ω_i) + Σ_j α_ij r(ω_i, ω_j) (eq. message-passing), [B, K, H].

    exp α̃_ii is multiplied by `self_weight`; of an r that hears nothing, its last bias remains.
    Where programs move objects, pairs are weighed by p1_i p2_j exp α̃_ij, as shares of their sum.
    What is avoided adds Σ p_avoid_i a(ω_i).
    """
    (p, targets), n = roles(network, named, seen), seen.objects.shape[1]
    w = columns(network, seen)
    if not network.relations_see_properties:
        w = w.index_fill(-1, torch.arange(7, network.world.object_features), 0.0)
    receivers, senders = w[:, :, None].expand(-1, -1, n, -1), w[:, None].expand(-1, n, -1, -1)
    queries, contexts = linear(named, "query", w)[:, :, None], linear(named, "context", w)[:, None]
    scores = torch.tanh(queries + contexts)  # [B, N, N, A]
    own = 1.0 - (1.0 - network.self_weight) * torch.eye(n, dtype=w.dtype)
    heard = targets[:, :, None] * (torch.exp(scores @ named["attention.weight"]) * own)[:, None]
    total = heard.sum(-1, keepdim=True)  # [B, K, N, 1]
    alpha = torch.where(total > 0, heard / total.clamp_min(1e-30), 0.0)
    first = linear(named, "message.0", torch.cat([receivers, senders], -1))[:, None]
    if "relation.weight" in named:
        first = first + added(network, named, seen)[:, :, None, None]
    r = linear(named, "message.1", torch.tanh(first))  # [B, K or 1, N, N, H]
    if network.vocabulary.moves_objects:
        pairs = p[..., None] * heard
        most = (scores @ named["attention.weight"]).detach().amax((-2, -1))[:, None, None, None]
        pairs = pairs / (pairs.sum((-2, -1), keepdim=True) + 1e-6 * torch.exp(most))
        told = mlp(named, "local", w)[:, None, :, None] + r
        return (pairs[..., None] * told).sum((2, 3))
    nothing = (total == 0) * named["message.1.bias"]
    told = (alpha[..., None] * r).sum(3) + nothing
    h = torch.einsum("bki,bkih->bkh", p, mlp(named, "local", w)[:, None] + told)
    return h + avoided(network, named, seen, w) if "avoid.1.weight" in named else h


def avoided(network: NetworkConfig, named: Named, seen: Scenes, w: Tensor) -> Tensor:
    """What h has of the objects that each program avoids, [B, K, H]."""
    phi = properties(network, named, seen)
    blocks = torch.ones_like(seen.objects[..., 0])
    blocks[:, seen.hand_index] = 0.0
    logic = seen.logic
    p = torch.stack(
        [
            blocks * (0.0 if one.avoided is None else degree(one.avoided, phi.__getitem__, logic))
            for one in seen.programs
        ],
        1,
    )[torch.arange(len(blocks))[:, None], seen.row]  # [B, K, N]
    told = torch.tanh(linear(named, "avoid.0", w)) @ named["avoid.1.weight"].T
    return torch.einsum("bki,bih->bkh", p, told)


def added(network: NetworkConfig, named: Named, seen: Scenes) -> Tensor:
    """What the relation of each program adds to r's first layer, [B, K, H]."""
    rows = network.vocabulary.relation_row
    asked = torch.tensor([rows[program.relation] for program in seen.programs])
    return named["relation.weight"].T[asked[seen.row]]


def actor(network: NetworkConfig, named: Named, seen: Scenes) -> Tensor:
    """a = tanh(Linear(tanh h)), [B, K, 6]."""
    h = torch.tanh(trunk(network, named, seen))
    return torch.tanh(linear(named, "output", upper(network, named, h)))


def upper(network: NetworkConfig, named: Named, z: Tensor) -> Tensor:
    for layer in range(network.upper_layers):
        z = torch.tanh(linear(named, f"upper.{layer}", z))
    return z


def critic(network: NetworkConfig, named: Named, seen: Scenes, action: Tensor) -> Tensor:
    """Q = Linear(tanh(h + Linear(a))), [B, K], for actions [B, K or 1, 6]."""
    hidden = torch.tanh(trunk(network, named, seen) + linear(named, "action", action))
    return linear(named, "output", upper(network, named, hidden))[..., 0]


class StraightforwardEngine:
    """One DPG update (appendix): what `Engine.update` must compute."""

    name = "straightforward"

    def __init__(
        self,
        network: NetworkConfig,
        config: DPGConfig,
        table: ProgramTable,
        actor: Mapping[str, NDArray[Any]],
        critic: Mapping[str, NDArray[Any]],
    ) -> None:
        self.network, self._config, self._table = network, config, table
        self._dtype: torch.dtype = getattr(torch, config.engine.dtype)
        self.networks = {
            name: parameters(tensors, self._dtype)
            for name, tensors in (("actor", actor), ("critic", critic))
        }
        self.end_episode()
        self._moments = {
            f"adam.{name}.{moment}.{k}": torch.zeros_like(tensor)
            for name in ("actor", "critic")
            for moment in "mv"
            for k, tensor in self.networks[name].items()
        }
        self._steps = 0
        self.loss = float("nan")  # of the latest update

    def update(self, batch: Batch) -> None:
        """Both gradients at the parameters before it."""
        gradients, optimizer = self.gradients(batch), self._config.optimizer
        share = 0.5 ** (self._steps / optimizer.half_life) if optimizer.half_life else 1.0
        self._steps += 1
        for name, rate in (("actor", optimizer.actor_rate), ("critic", optimizer.critic_rate)):
            for k, gradient in gradients[name].items():
                self._step(name, k, gradient, share * rate)

    def gradients(self, batch: Batch) -> dict[str, Named]:
        """Of the critic's loss, and of minus the actor's objective: Q with its slope clipped."""
        network, nets = self.network, self.networks
        now, after = (
            self._scenes(batch.objects, batch.arm, batch),
            self._scenes(batch.next_objects, batch.next_arm, batch),
        )
        taken, reward, discount = map(self._given, (batch.action, batch.reward, batch.discount))
        with torch.no_grad():
            following = actor(network, nets["target_actor"], after)
            value = critic(network, nets["target_critic"], after, following)
            target = reward + discount[:, None] * value
        loss = ((target - critic(network, nets["critic"], now, taken[:, None])) ** 2).mean()
        action = actor(network, nets["actor"], now)
        given = action.detach().requires_grad_()
        (slope,) = torch.autograd.grad(critic(network, nets["critic"], now, given).sum(), given)
        clip = self._config.gradient_clip
        ascent = slope.clamp(-clip, clip) - self._config.action_penalty * given.detach()
        self.loss = float(loss.detach())
        gradients = {
            "critic": _gradients(loss, nets["critic"], None),
            "actor": _gradients(action, nets["actor"], -ascent / target.numel()),
        }
        for found in gradients.values():
            if "detectors.bias" in found and not network.detectors_have_biases:
                found["detectors.bias"].zero_()
            if "detectors.weight" in found and not network.detectors_see_arm:
                found["detectors.weight"][:, network.world.object_features :].zero_()
        return gradients

    def end_episode(self) -> None:
        """Hard copies."""
        for name in ("actor", "critic"):
            copied = {k: tensor.detach().clone() for k, tensor in self.networks[name].items()}
            self.networks[f"target_{name}"] = copied

    def tensors(self) -> dict[str, NDArray[Any]]:
        """As `Engine.tensors` names them, but for the count of steps."""
        named = {f"{name}.{k}": x for name, net in self.networks.items() for k, x in net.items()}
        return {k: x.detach().numpy().copy() for k, x in (named | self._moments).items()}

    @torch.no_grad()
    def _step(self, name: str, k: str, gradient: Tensor, rate: float) -> None:
        """Kingma & Ba 2015, algorithm 1; then detectors are drawn to zero (Zhang 2010)."""
        config, x = self._config, self.networks[name][k]
        detects, weighs = k.startswith("detectors."), k == "detectors.weight"
        rate = rate * config.detectors.gain if detects else rate
        m, v = (self._moments[f"adam.{name}.{moment}.{k}"] for moment in "mv")
        m.copy_(config.optimizer.beta1 * m + (1 - config.optimizer.beta1) * gradient)
        v.copy_(config.optimizer.beta2 * v + (1 - config.optimizer.beta2) * gradient**2)
        root = torch.sqrt(v / (1 - config.optimizer.beta2**self._steps)) + config.optimizer.epsilon
        x -= rate * (m / (1 - config.optimizer.beta1**self._steps)) / root
        if weighs:
            part = torch.clamp(1 - x.abs() / config.detectors.free_from, min=0)
            x -= torch.sign(x) * torch.minimum(x.abs(), rate * config.detectors.sparsity * part)

    def _scenes(self, objects: NDArray[Any], arm: NDArray[Any], batch: Batch) -> Scenes:
        programs = self._table.programs
        row = torch.from_numpy(batch.program).long()
        return Scenes(self._given(objects), self._given(arm), programs, row)

    def _given(self, array: NDArray[Any]) -> Tensor:
        return torch.from_numpy(np.asarray(array)).to(self._dtype)


def _gradients(of: Tensor, named: Named, weights: Tensor | None) -> Named:
    found = torch.autograd.grad(of, list(named.values()), weights, materialize_grads=True)
    return dict(zip(named, found, strict=True))
