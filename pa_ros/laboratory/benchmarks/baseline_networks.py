"""Networks of other kinds that learn from the same batches as ours: for the benchmark `baselines`.

Each takes objects [B, N, F], arm [B, A] and a goal, and is trained by our DPG, or by SAC. They are
registered as algorithms, as an extension would do it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation
from pa_ros.core.update import HAND_INDEX
from pa_ros.language import And, Program, Vocabulary, Word
from pa_ros.learning.algorithms import ALGORITHMS, Algorithm
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.learning.algorithms.dpg.learner import TorchDPG
from pa_ros.learning.algorithms.torch_engine import ACTOR, Inputs, TorchEngine
from pa_ros.networks.canonical import FlattenedInput
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import Tensors
from pa_ros.world.programs import ProgramTable

WIDTH = 128  # of what networks make of a scene and a goal
TOKEN_WIDTH, HEADS, LAYERS = 64, 4, 2  # of the Transformer, so that it has about 10⁵ weights, too
TOKENS = 96  # of the longest program; those of depth 6 have fewer
TAU = 0.005  # SAC's targets follow so fast (Haarnoja et al. 2018)


def one_hots(program: Program, vocabulary: Vocabulary) -> Float32:
    """The words of the target, [V]. ConfigError unless it is one word or an AND of words."""
    target = program.target
    parts = target.operands if isinstance(target, And) else (target,)
    if not all(isinstance(part, Word) for part in parts):
        raise ConfigError(f"one-hot goals: expected a conjunction of words, got {program}")
    goal = np.zeros(len(vocabulary.words), np.float32)
    goal[[vocabulary.row[word] for word in program.words]] = 1.0
    return goal


def tokens(program: Program, vocabulary: Vocabulary) -> NDArray[np.int64]:
    """Numbers of the words, operators and brackets of the target's text, then zeros: [TOKENS]."""
    known = ["", "(", ")", "AND", "OR", "NOT", *vocabulary.words]
    found = [known.index(text) for text in re.findall(r"\w+|[()]", str(program.target))]
    return np.pad(np.array(found, np.int64), (0, TOKENS - len(found)))


def _mlp(*sizes: int) -> nn.Sequential:
    """Linear layers, each followed by ReLU."""
    layers = [(nn.Linear(a, b), nn.ReLU()) for a, b in zip(sizes, sizes[1:], strict=False)]
    return nn.Sequential(*(part for layer in layers for part in layer))


class Columns(nn.Module):
    """ω of each object: its scaled features, then the arm's: [B, N, C]."""

    scales: Tensor

    def __init__(self, network: NetworkConfig) -> None:
        super().__init__()
        self.register_buffer("scales", torch.from_numpy(network.input_scales), persistent=False)

    def forward(self, objects: Tensor, arm: Tensor) -> Tensor:
        arms = arm[:, None].expand(-1, objects.shape[1], -1)
        return torch.cat([objects * self.scales, arms], -1)


class DeepSets(nn.Module):
    """ρ(Σ φ(ω_i, goal)) (Zaheer et al. 2017)."""

    encode = staticmethod(one_hots)

    def __init__(self, network: NetworkConfig) -> None:
        super().__init__()
        self.columns = Columns(network)
        inputs = network.world.columns + len(network.vocabulary.words)
        self.each, self.all = _mlp(inputs, WIDTH, WIDTH), _mlp(WIDTH, WIDTH)

    def forward(self, objects: Tensor, arm: Tensor, goal: Tensor) -> Tensor:
        """[B, K, WIDTH], for goals [B, K, V]."""
        x = self.columns(objects, arm)
        x = x[:, None].expand(-1, goal.shape[1], -1, -1)
        goals = goal[:, :, None].expand(-1, -1, x.shape[2], -1)
        h: Tensor = self.all(self.each(torch.cat([x, goals], -1)).sum(2))
        return h


class FilmTransformer(nn.Module):
    """Attention among objects; a GRU reads the program and scales each layer (Perez et al. 2018).

    The hand's column is the answer.
    """

    encode = staticmethod(tokens)

    def __init__(self, network: NetworkConfig) -> None:
        super().__init__()
        self.columns = Columns(network)
        self.words = nn.Embedding(6 + len(network.vocabulary.words), TOKEN_WIDTH, padding_idx=0)
        self.reader = nn.GRU(TOKEN_WIDTH, TOKEN_WIDTH, batch_first=True)
        self.first = nn.Linear(network.world.columns, TOKEN_WIDTH)
        self.layers = nn.ModuleList(
            nn.TransformerEncoderLayer(
                TOKEN_WIDTH, HEADS, 2 * TOKEN_WIDTH, dropout=0.0, batch_first=True
            )
            for _ in range(LAYERS)
        )
        self.film = nn.ModuleList(nn.Linear(TOKEN_WIDTH, 2 * TOKEN_WIDTH) for _ in range(LAYERS))
        self.last = nn.Linear(TOKEN_WIDTH, WIDTH)

    def forward(self, objects: Tensor, arm: Tensor, goal: Tensor) -> Tensor:
        """[B, K, WIDTH], for tokens [B, K, TOKENS]."""
        batch, programs = goal.shape[:2]
        text, of = torch.unique(goal.flatten(0, 1), dim=0, return_inverse=True)  # few differ
        length = (text > 0).sum(1)
        read, _ = self.reader(self.words(text[:, : int(length.max())]))  # [programs, T, WIDTH]
        meaning = read[torch.arange(len(text)), length - 1][of]
        x = self.first(self.columns(objects, arm)).repeat_interleave(programs, 0)
        for layer, film in zip(self.layers, self.film, strict=True):
            scale, shift = film(meaning)[:, None].chunk(2, -1)
            x = layer(x * (1.0 + scale) + shift)
        h: Tensor = self.last(x[:, HAND_INDEX]).unflatten(0, (batch, programs))
        return h


class Flat(nn.Module):
    """An MLP on the canonical network's input: a slot for each kind of block."""

    encode = staticmethod(one_hots)

    def __init__(self, network: NetworkConfig) -> None:
        super().__init__()
        self.flatten = FlattenedInput(network)
        world, slots = network.world, 1 + len(self.flatten.slots)
        inputs = slots * world.object_features + world.arm_features + len(world.vocabulary.words)
        self.layers = _mlp(inputs, 2 * WIDTH, WIDTH)

    def forward(self, objects: Tensor, arm: Tensor, goal: Tensor) -> Tensor:
        """[B, K, WIDTH], for goals [B, K, V]."""
        h: Tensor = self.layers(self.flatten(objects, arm, goal, HAND_INDEX))
        return h


Encoder = Callable[[NetworkConfig], nn.Module]


class BaselineActor(nn.Module):
    """`outputs` numbers for each action: 1, bounded by tanh, or 2: mean and log deviation."""

    def __init__(self, network: NetworkConfig, encoder: Encoder, outputs: int) -> None:
        super().__init__()
        self.encoder, self.bounded = encoder(network), outputs == 1
        self.output = nn.Linear(WIDTH, outputs * network.world.actions)
        with torch.no_grad():
            self.output.weight.mul_(0.1)

    def forward(self, objects: Tensor, arm: Tensor, goal: Tensor, hand_index: int = 0) -> Tensor:
        y: Tensor = self.output(self.encoder(objects, arm, goal))
        return torch.tanh(y) if self.bounded else y


class BaselineCritic(nn.Module):
    """Q of the encoder's answer and an action."""

    def __init__(self, network: NetworkConfig, encoder: Encoder, discount: float) -> None:
        super().__init__()
        self.encoder = encoder(network)
        output = nn.Linear(WIDTH, 1)
        with torch.no_grad():
            output.bias.fill_(network.critic_start(discount))
        self.last = nn.Sequential(_mlp(WIDTH + network.world.actions, WIDTH), output)

    def trunk(self, objects: Tensor, arm: Tensor, goal: Tensor, hand_index: int = 0) -> Tensor:
        h: Tensor = self.encoder(objects, arm, goal)
        return h

    def head(self, h: Tensor, action: Tensor) -> Tensor:
        """Q, [B, K], for actions [B, J] or [B, K, J]."""
        if action.dim() == 2:
            action = action[:, None].expand(-1, h.shape[1], -1)
        q: Tensor = self.last(torch.cat([h, action], -1))
        return q.squeeze(-1)


class _Encoded(TorchEngine):
    """An engine whose networks take programs as an encoder reads them."""

    encoder: ClassVar[Any]
    outputs: ClassVar[int] = 1

    def _module(self, name: str, tensors: Tensors) -> nn.Module:
        if name == ACTOR:
            return BaselineActor(self._network, self.encoder, self.outputs)
        return BaselineCritic(self._network, self.encoder, self._config.updates.discount)

    def programs(self, program: NDArray[np.int32]) -> Any:
        if self._known != len(self._table):
            rows = [self.encode(one) for one in self._table.programs]
            self._rows, self._known = [torch.from_numpy(np.stack(rows))], len(rows)
        return self._rows[0][torch.from_numpy(program).long()]

    def encode(self, program: Program) -> NDArray[Any]:
        """A program as the networks take it; ConfigError if they cannot."""
        encoded: NDArray[Any] = self.encoder.encode(program, self._network.vocabulary)
        return encoded

    def answer(self, seen: Observation, program: Program) -> Tensor:
        """The actor's outputs for one observation, [outputs · J]."""
        arm = torch.from_numpy(self._network.world.arm(seen))[None]
        goal = torch.from_numpy(self.encode(program))[None, None]
        with torch.no_grad():
            y: Tensor = self.networks[ACTOR](torch.from_numpy(seen.objects)[None], arm, goal)
        return y[0, 0]

    def greedy(self, seen: Observation, program: Program) -> Float32:
        """The action without exploration, [J] in [-1, 1]."""
        return self.answer(seen, program).numpy()


class SAC(_Encoded):
    """Soft actor-critic with two critics and a learned temperature (Haarnoja et al. 2018)."""

    encoder, outputs = Flat, 2

    def __init__(self, network: NetworkConfig, config: DPGConfig, table: ProgramTable) -> None:
        super().__init__(network, config, table, {ACTOR: {}, "critic_1": {}, "critic_2": {}})
        self._log_alpha = torch.zeros((), requires_grad=True)
        self._adam_alpha = torch.optim.Adam([self._log_alpha], lr=config.optimizer.critic_rate)

    def greedy(self, seen: Observation, program: Program) -> Float32:
        mean: Tensor = torch.tanh(self.answer(seen, program).chunk(2, -1)[0])
        return mean.numpy()

    def sampled(self, seen: Observation, program: Program) -> Float32:
        """An action with the policy's own noise, by which SAC explores."""
        return _sample(self.answer(seen, program))[0].numpy()

    def step(self, x: Inputs) -> tuple[Tensor, Tensor]:
        critics, alpha = ("critic_1", "critic_2"), self._log_alpha.exp().detach()
        with torch.no_grad():
            then, log_p = _sample(self.act(self.networks[ACTOR], x.then))
            values = [self.targets[c].head(self.features(self.targets[c], x.then), then)
                      for c in critics]  # fmt: skip
            soft = torch.minimum(*values) - alpha * log_p
            target = x.reward + x.discount[:, None] * soft
        for name in critics:
            critic = self.networks[name]
            q = critic.head(self.features(critic, x.now), x.action)
            loss = F.mse_loss(q, target)
            self.descend(name, loss)
        action, log_p = _sample(self.act(self.networks[ACTOR], x.now))
        values = [self.networks[c].head(self.features(self.networks[c], x.now), action)
                  for c in critics]  # fmt: skip
        self.descend(ACTOR, (alpha * log_p - torch.minimum(*values)).mean())
        self._adam_alpha.zero_grad()
        wanted = -float(self._network.world.actions)
        torch.autograd.backward(-self._log_alpha * (log_p.detach() + wanted).mean())
        self._adam_alpha.step()
        with torch.no_grad():
            for name in critics:
                for old, new in zip(self.targets[name].parameters(),
                                    self.networks[name].parameters(), strict=True):  # fmt: skip
                    old.lerp_(new, TAU)
        return loss.detach(), q.detach().mean()

    def end_episode(self) -> None:
        """Targets follow slowly instead."""


def _sample(outputs: Tensor) -> tuple[Tensor, Tensor]:
    """Actions [..., J] of a squashed normal distribution, and their log densities [...]."""
    mean, log_deviation = outputs.chunk(2, -1)
    deviation = log_deviation.clamp(-5.0, 2.0).exp()
    noise = torch.randn_like(mean)
    x = mean + deviation * noise
    density = -0.5 * noise.square() - deviation.log() - 0.5 * np.log(2.0 * np.pi)
    # The last part is log(1 - tanh(x)²), for any x.
    log_p = density - 2.0 * (np.log(2.0) - x - F.softplus(-2.0 * x))
    return torch.tanh(x), log_p.sum(-1)


class DeepSetsDPG(_Encoded, TorchDPG):
    encoder = DeepSets


class FilmDPG(_Encoded, TorchDPG):
    encoder = FilmTransformer


class DeepSetsConfig(DPGConfig):
    ALGORITHM: ClassVar[str] = "deep-sets"


class FilmConfig(DPGConfig):
    ALGORITHM: ClassVar[str] = "film-transformer"


class SACConfig(DPGConfig):
    ALGORITHM: ClassVar[str] = "sac"


# Rates that suit ReLU networks of this size; `--rates` multiplies them.
_RATES = {"ours": {"learner.optimizer.actor_rate": 3e-4, "learner.optimizer.critic_rate": 3e-4}}


def register() -> None:
    """Register the baselines as algorithms."""

    def dpg(kind: type[Any]) -> Callable[..., Any]:
        return lambda network, config, table, rng: kind(network, config, table, {}, {})

    def sac(network: NetworkConfig, config: DPGConfig, table: ProgramTable, rng: Any) -> SAC:
        return SAC(network, config, table)

    for config, make in (
        (DeepSetsConfig, dpg(DeepSetsDPG)), (FilmConfig, dpg(FilmDPG)), (SACConfig, sac)
    ):  # fmt: skip
        if config.ALGORITHM not in ALGORITHMS:
            ALGORITHMS.register(config.ALGORITHM, Algorithm(config, make, _RATES))
