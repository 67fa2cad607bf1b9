"""Programmable actor and critic: the readable reference in torch.

Source: paper, sections "Executing programs" to "Relational reasoning" (eq. message-passing) and
appendix "Model and training details". Two algebraic identities make them cheaper without changing
what they compute: the first layer of r is a sum of a receiver's and a sender's part, and its last
layer, being linear, is applied once to the weighted sum of messages, since only Σ p_i ω'_i is used.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from pa_ros.language import PRODUCT, Logic
from pa_ros.language.flat import Compiled
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import LITTLE, NOTHING
from pa_ros.networks.properties import TrueProperties
from pa_ros.networks.relevance import relevant_objects, relevant_sets


class Programs(Compiled):
    """K compiled programs for each of B scenes, int tensors: instructions [B, K, L], all else
    [B, K]."""

    __slots__ = ()

    def relevant_objects(self, phi: Tensor, hand_index: int, logic: Logic = PRODUCT) -> Tensor:
        """p, [B, K, N], of Φ [B, V, N]; see `pa_ros.world.programs`."""
        return relevant_objects(phi, hand_index, self, logic)

    def sets(self, phi: Tensor, hand_index: int, logic: Logic) -> tuple[Tensor, Tensor]:
        """Degrees p1 and p2 of the moved and the target set, [B, K, N] each."""
        registers = torch.stack([self.moved, self.target], -1)
        moved, target = relevant_sets(phi, hand_index, self, registers, logic).unbind(-2)
        return moved, target

    def to_avoid(self, phi: Tensor, hand_index: int, logic: Logic) -> Tensor:
        """Degrees of the set to avoid, p_avoid [B, K, N]; all 0 for programs that avoid nothing."""
        degrees = relevant_sets(phi, hand_index, self, self.avoided[..., None], logic)[..., 0, :]
        return degrees * (torch.arange(phi.shape[-1], device=phi.device) != hand_index).to(phi)


class Weight(nn.Module):
    """A tensor that is learned, called `weight` in a state dict."""

    def __init__(self, *shape: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(shape))


class Detectors(nn.Module):
    """Φ from Ω: the first layer of all networks that evaluate programs.

    With `learned_detectors` Φ is computed by detectors, else it is the true one. `logic` joins
    degrees: PRODUCT, unless an actor is set to another.
    """

    logic: Logic = PRODUCT
    scales: Tensor  # [F]
    seen: Tensor  # [F + A]: 1 for what may act on the action but through p, else 0

    def __init__(self, config: NetworkConfig, learned_detectors: bool = True) -> None:
        super().__init__()
        self._group_sizes = config.vocabulary.group_sizes
        columns = config.world.columns
        self._detected = columns if config.detectors_see_arm else config.world.object_features
        self._learned = learned_detectors
        if learned_detectors:
            self.detectors = nn.Linear(columns, len(config.vocabulary.words))
            self.detectors.bias.requires_grad_(config.detectors_have_biases)
            self.detectors.weight.data *= config.detector_init_scale
            self.detectors.bias.data *= config.detector_init_scale * config.detectors_have_biases
        self.true = TrueProperties(config.world)
        self.register_buffer("scales", torch.from_numpy(config.input_scales), persistent=False)
        seen = torch.ones(columns)
        if not config.relations_see_properties:
            seen[config.world.schema.properties] = 0.0
        self.register_buffer("seen", seen, persistent=False)

    def phi(self, objects: Tensor, arm: Tensor) -> Tensor:
        """Φ, [B, V, N], of objects [B, N, F] and arm [B, A]: learned, or true."""
        if not self._learned:
            truth: Tensor = self.true(objects).transpose(1, 2)
            return truth
        columns, weight = self.columns(objects, arm), self.detectors.weight
        if (seen := self._detected) < columns.shape[-1]:
            columns, weight = columns[..., :seen], weight[:, :seen]
        logits = nn.functional.linear(columns, weight, self.detectors.bias)
        groups = torch.split_with_sizes(logits, self._group_sizes, dim=-1)
        return torch.cat([group.softmax(-1) for group in groups], -1).transpose(1, 2)

    def columns(self, objects: Tensor, arm: Tensor) -> Tensor:
        """ω, [B, N, F + A]: scaled objects, each with the arm."""
        arms = arm[:, None, :].expand(-1, objects.shape[1], -1)
        return torch.cat([objects * self.scales, arms], -1)


class Trunk(Detectors):
    """h = Σ p_i ω'_i from Ω and programs; actor and critic each have their own."""

    def __init__(self, config: NetworkConfig, learned_detectors: bool) -> None:
        super().__init__(config, learned_detectors)
        columns, self._self_weight = config.world.columns, config.self_weight
        self.query = nn.Linear(columns, config.attention)
        self.context = nn.Linear(columns, config.attention)
        self.attention = Weight(config.attention)  # w of the neighbourhood attention
        hidden = config.hidden
        self.local = nn.ModuleList([nn.Linear(columns, hidden), nn.Linear(hidden, hidden)])
        self.message = nn.ModuleList([nn.Linear(2 * columns, hidden), nn.Linear(hidden, hidden)])
        words = config.vocabulary
        self._by_roles, self._avoids = words.moves_objects, words.avoids
        if several := words.relation_inputs:
            # A vector for each relation, added in the first layer of r: "parameterizing the
            # message passing operation based on the relation to be achieved" (paper, appendix).
            self.relation = Weight(hidden, several)
        if self._avoids:
            last = nn.Linear(hidden, hidden, bias=False)
            self.avoid = nn.ModuleList([nn.Linear(columns, hidden), last])
        upper = [nn.Linear(hidden, hidden) for _ in range(config.upper_layers)]
        self.upper = nn.ModuleList(upper)  # between h and the output

    def trunk(self, objects: Tensor, arm: Tensor, programs: Programs, hand_index: int) -> Tensor:
        """Compute h, [B, K, H], of objects [B, N, F] and arm [B, A] under K programs each."""
        phi = self.phi(objects, arm)
        columns = self.columns(objects, arm) * self.seen
        scores = self._scores(columns)  # [B, N, N]
        if self._by_roles:
            weights = self._pairs(scores, *programs.sets(phi, hand_index, self.logic))
            p = weights.sum(-1)
        else:
            p = programs.relevant_objects(phi, hand_index, self.logic)  # [B, K, N]
            weights = p[..., None] * self._attention(scores, p)  # [B, K, N, N]
        first, local_last = _layers(self.local)
        message_last = _layers(self.message)[1]
        local = torch.tanh(first(columns))  # [B, N, H]
        f = p @ local
        r = self._pooled(weights, self._sums(columns), programs.relation)
        # the last layers of f and r; every row of α sums to one, so both biases weigh Σ p
        bias = p.sum(-1, keepdim=True) * (local_last.bias + message_last.bias)
        h = f @ local_last.weight.T + r @ message_last.weight.T + bias
        if self._avoids:
            first, last = _layers(self.avoid)
            h = h + last(
                programs.to_avoid(phi, hand_index, self.logic) @ torch.tanh(first(columns))
            )
        return h

    def raised(self, hidden: Tensor) -> Tensor:
        """tanh of the pre-activations [..., H], through the upper layers."""
        z = torch.tanh(hidden)
        for layer in self.upper:
            z = torch.tanh(layer(z))
        return z

    def _scores(self, columns: Tensor) -> Tensor:
        """α̃_ij = w·tanh(q_i + c_j) of each pair, [B, N, N]."""
        pairs = self.query(columns)[:, :, None] + self.context(columns)[:, None]
        return torch.tanh(pairs) @ self.attention.weight

    def _attention(self, scores: Tensor, p: Tensor) -> Tensor:
        """α, [B, K, N, N]: α_ij ∝ p_j exp α̃_ij, each row summing to one.

        Where no other object is relevant at all, a row is 0: that object receives no message.
        """
        scores = torch.exp(scores - scores.detach().amax(-1, keepdim=True))
        weights = p[:, :, None, :] * (scores * self.senders(p.shape[-1]))[:, None]  # [B, K, N, N]
        return weights / weights.sum(-1, keepdim=True).clamp_min(NOTHING)

    def _pairs(self, scores: Tensor, moved: Tensor, target: Tensor) -> Tensor:
        """Weights of pairs, [B, K, N, N]: ∝ p1_i p2_j exp α̃_ij, summing to one over all pairs.

        So where a set contains several objects, the attention chooses among them.
        """
        scores = torch.exp(scores - scores.detach().amax((-2, -1), keepdim=True))
        scores = (scores * self.senders(moved.shape[-1]))[:, None]
        weights = moved[..., None] * target[..., None, :] * scores
        return weights / (weights.sum((-2, -1), keepdim=True) + LITTLE)

    def senders(self, n: int) -> Tensor:
        """[N, N]: the weight of each object j (column) to object i, 1 but for itself."""
        ones = torch.ones(n, n, dtype=self.seen.dtype, device=self.seen.device)
        return ones.fill_diagonal_(self._self_weight)

    def _pooled(self, weights: Tensor, sums: Tensor, relation: Tensor) -> Tensor:
        """Σ p_i α_ij tanh(r0_ij), [B, K, H], of weights [B, K, N, N] and r0 [B, N, N, H].

        Programs of one relation share their messages; where there are several, each program's have
        its own relation's share: one pass for a batch that mixes them, and K times the messages.
        """
        if not hasattr(self, "relation"):
            return weights.flatten(2) @ torch.tanh(sums).flatten(1, 2)
        shares = self.relation.weight.T[relation][:, :, None, None]  # [B, K, 1, 1, H]
        messages = torch.tanh(sums[:, None] + shares)  # [B, K, N, N, H]
        return (weights.flatten(2)[:, :, None] @ messages.flatten(2, 3)).squeeze(2)

    def _sums(self, columns: Tensor) -> Tensor:
        """First layer of r before tanh on every pair (receiver i, sender j): [B, N, N, H]."""
        first = _layers(self.message)[0]
        receiver, sender = torch.hsplit(first.weight, 2)  # [H, F + A] each
        received = F.linear(columns, receiver, first.bias)
        return received[:, :, None] + F.linear(columns, sender)[:, None]


class ProgrammableActor(Trunk):
    """a = tanh(Linear(tanh h)) (paper, appendix), with `upper_layers` before the last."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, learned_detectors=family_of(config).detects(critic=False))
        self.output = nn.Linear(config.hidden, config.world.actions)

    def forward(
        self, objects: Tensor, arm: Tensor, programs: Programs, hand_index: int = 0
    ) -> Tensor:
        """Actions in [-1, 1], [B, K, J]; see `Trunk.trunk` for the inputs."""
        h = self.trunk(objects, arm, programs, hand_index)
        return torch.tanh(self.output(self.raised(h)))


class ProgrammableCritic(Trunk):
    """Q = Linear(tanh(h + Linear(a))) (paper, appendix), with `upper_layers` before the last."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, learned_detectors=family_of(config).detects(critic=True))
        self.action = nn.Linear(config.world.actions, config.hidden)
        self.output = nn.Linear(config.hidden, 1)

    def head(self, h: Tensor, action: Tensor) -> Tensor:
        """Q, [B, K], of h [B, K, H] and an action per scene [B, J] or per program [B, K, J]."""
        embedded = self.action(action)
        if embedded.dim() == 2:
            embedded = embedded[:, None]  # [B, 1, H]
        q: Tensor = self.output(self.raised(h + embedded))
        return q.squeeze(-1)  # [B, K]

    def forward(
        self, objects: Tensor, arm: Tensor, programs: Programs, action: Tensor, hand_index: int = 0
    ) -> Tensor:
        """Q, [B, K]; see `Trunk.trunk` and `head` for the inputs."""
        return self.head(self.trunk(objects, arm, programs, hand_index), action)


def _layers(mlp: nn.ModuleList) -> tuple[nn.Linear, nn.Linear]:
    first, last = mlp
    assert isinstance(first, nn.Linear) and isinstance(last, nn.Linear)
    return first, last
