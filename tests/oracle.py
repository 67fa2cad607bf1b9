"""The paper's formulas, one sample, one object and one pair at a time, in torch float64.

Nothing is shared with the real implementation but the names of the tensors: programs are run over
their tree, r is an MLP of a concatenated pair with its last layer inside the sum, and gradients
are autograd's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pa_ros.core.experience import COLORS, SHAPES
from pa_ros.language import And, Expression, Not, Or, Program, Vocabulary, Word

Named = dict[str, Tensor]

GEOMETRY = [*range(7), *range(16, 34)]  # what is no property in ω: position, orientation, arm


class Scene(NamedTuple):
    """What both networks are given, float64: objects [N, 16] and arm [18]."""

    objects: Tensor
    arm: Tensor
    program: Program
    vocabulary: Vocabulary
    hand_index: int = 0
    position_scale: float = 5.0
    self_weight: float = 1.0


def parameters(tensors: Mapping[str, np.ndarray]) -> Named:
    """Leaves of autograd in float64."""
    return {k: torch.tensor(v, dtype=torch.float64, requires_grad=True) for k, v in tensors.items()}


def linear(named: Named, layer: str, x: Tensor) -> Tensor:
    return named[f"{layer}.weight"] @ x + named[f"{layer}.bias"]


def mlp(named: Named, name: str, x: Tensor) -> Tensor:
    return linear(named, f"{name}.1", torch.tanh(linear(named, f"{name}.0", x)))


def column(scene: Scene, i: int) -> Tensor:
    """ω_i: positions scaled, the arm's features appended (appendix)."""
    own = scene.objects[i]
    return torch.cat([own[:3] * scene.position_scale, own[3:], scene.arm])


def properties(named: Named, scene: Scene, i: int) -> dict[str, Tensor]:
    """Column i of Φ by word: one softmax per group of detectors, or the one-hots of Ω."""
    vocabulary = scene.vocabulary
    if "detectors.weight" not in named:
        one_hots = scene.objects[i, 7:]
        true = dict(zip(SHAPES + COLORS, one_hots, strict=True))
        return {word: true.get(word, torch.tensor(0.0).double()) for word in vocabulary.words}
    logits = dict(zip(vocabulary.words, linear(named, "detectors", column(scene, i)), strict=True))
    phi = {}
    for group in (vocabulary.shapes, vocabulary.colors):
        total = sum(torch.exp(logits[word]) for word in group)
        phi |= {word: torch.exp(logits[word]) / total for word in group}
    return phi


def degree(expression: Expression, phi: dict[str, Tensor]) -> Tensor:
    """Eq. logic: not x = 1 − x, x and y = xy, x or y = x + y − xy."""
    match expression:
        case Word(name):
            return phi[name]
        case Not(operand):
            return 1 - degree(operand, phi)
        case And((first, *others)):
            result = degree(first, phi)
            for other in others:
                result = result * degree(other, phi)
            return result
        case Or((first, *others)):
            result = degree(first, phi)
            for other in others:
                y = degree(other, phi)
                result = result + y - result * y
            return result
    raise AssertionError(expression)


def relevance(named: Named, scene: Scene, i: int) -> Tensor:
    """p_i = OR(HAND, e)."""
    e = degree(scene.program.target, properties(named, scene, i))
    hand = 1.0 if i == scene.hand_index else 0.0
    return hand + e - hand * e


def trunk(named: Named, scene: Scene) -> Tensor:
    """h = Σ p_i ω'_i, ω'_i = f(ω_i) + Σ_j α_ij r(ω_i, ω_j) (eq. message-passing).

    exp α̃_ii is multiplied by `self_weight`; of an r that hears nothing, its last bias remains.
    """
    n = range(len(scene.objects))
    w = [column(scene, i) for i in n]
    p = [relevance(named, scene, i) for i in n]
    h = torch.zeros_like(named["local.1.bias"])
    for i in n:
        q = linear(named, "query", w[i])
        weight = [scene.self_weight if j == i else 1.0 for j in n]
        senders = [j for j in n if weight[j] > 0]
        scores = [
            named["attention.weight"] @ torch.tanh(q + linear(named, "context", w[j])) for j in n
        ]
        total = sum(p[k] * weight[k] * torch.exp(scores[k]) for k in senders)
        new = mlp(named, "local", w[i])
        if total == 0:
            new = new + named["message.1.bias"]
            senders = []
        for j in senders:
            alpha = p[j] * weight[j] * torch.exp(scores[j]) / total
            new = new + alpha * mlp(named, "message", torch.cat([w[i], w[j]]))
        h = h + p[i] * new
    return h


def actor(named: Named, scene: Scene) -> Tensor:
    """a = tanh(Linear(tanh h)), [6]."""
    return torch.tanh(linear(named, "output", torch.tanh(trunk(named, scene))))


def critic(named: Named, scene: Scene, action: Tensor) -> Tensor:
    """Q = Linear(tanh(h + Linear(a))), a scalar."""
    hidden = torch.tanh(trunk(named, scene) + linear(named, "action", action))
    return linear(named, "output", hidden)[0]


class Transition(NamedTuple):
    """One transition under one program."""

    now: Scene
    action: Tensor
    reward: float
    discount: float
    after: Scene


def dpg_gradients(
    nets: dict[str, Named], transitions: list[Transition], clip: float, action_l2: float
) -> tuple[Named, Named]:
    """Gradients of the critic's loss and of minus the actor's objective (appendix).

    The objective is Q with its slope clipped, less `action_l2` · ½|a|².
    `nets` holds actor, critic, target_actor and target_critic.
    """
    loss, objective = torch.zeros(()).double(), torch.zeros(()).double()
    for t in transitions:
        with torch.no_grad():
            after = critic(nets["target_critic"], t.after, actor(nets["target_actor"], t.after))
        target = t.reward + t.discount * after
        loss = loss + (target - critic(nets["critic"], t.now, t.action)) ** 2
        action = actor(nets["actor"], t.now)
        given = action.detach().requires_grad_()
        (slope,) = torch.autograd.grad(critic(nets["critic"], t.now, given), given)
        objective = objective + slope.clamp(-clip, clip) @ action - action_l2 / 2 * action @ action
    count = len(transitions)
    of_critic = torch.autograd.grad(loss / count, list(nets["critic"].values()))
    of_actor = torch.autograd.grad(-objective / count, list(nets["actor"].values()))
    return (
        dict(zip(nets["actor"], of_actor, strict=True)),
        dict(zip(nets["critic"], of_critic, strict=True)),
    )


class Adam:
    """Kingma and Ba 2015, algorithm 1, in NumPy.

    Detectors step `detector_gain` times as far, and their weights decay as in Loshchilov and
    Hutter 2019, by `decay` at first and by nothing after `updates`.
    """

    beta1, beta2, eps = 0.9, 0.999, 1e-8

    def __init__(self, rate: float, detector_gain: float, decay: float, updates: int) -> None:
        self.rate, self.detector_gain = rate, detector_gain
        self.decay, self.updates = decay, updates
        self.step = 0
        self.m: dict[str, np.ndarray] = {}
        self.v: dict[str, np.ndarray] = {}

    def update(
        self,
        values: dict[str, np.ndarray],
        gradients: Mapping[str, np.ndarray],
        share: float = 1.0,  # of the rate
    ) -> None:
        self.step += 1
        for name, g in gradients.items():
            self.m[name] = self.beta1 * self.m.get(name, 0.0) + (1 - self.beta1) * g
            self.v[name] = self.beta2 * self.v.get(name, 0.0) + (1 - self.beta2) * g * g
            m = self.m[name] / (1 - self.beta1**self.step)
            v = self.v[name] / (1 - self.beta2**self.step)
            rate = (
                self.rate * share * (self.detector_gain if name.startswith("detectors.") else 1.0)
            )
            left = max(0.0, 1.0 - (self.step - 1) / self.updates)
            decay = self.decay * left if name == "detectors.weight" else 0.0
            values[name] = (1 - rate * decay) * values[name] - rate * m / (np.sqrt(v) + self.eps)
