"""The generalization figure: trained agents under every condition (paper, section 5).

All agents are scored on the same episodes of a condition, and so are the references: the scripted
and the random one, which define the scale, and the blind ones, which ignore the program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from laboratory.studies.scorer import Benchmark, Scorer
from pa_ros.agents import TrainedAgent, acting_under
from pa_ros.arena import ArenaConfig, Design
from pa_ros.core.errors import ConfigError
from pa_ros.core.software import device, versions
from pa_ros.evaluation.blind import BLIND
from pa_ros.evaluation.conditions import conditions_of
from pa_ros.evaluation.evaluate import EPISODES_SEED, REFERENCES
from pa_ros.evaluation.scores import gain_over, normalized, normalized_interval, rewards


@dataclass(frozen=True, slots=True)
class ConditionRow:
    """One episode of one seed: rewards per step of the agent and of all references."""

    seed: int
    condition: str
    episode: int
    program: str
    reward: float
    success: bool  # near at the end
    distance: float  # m, at the end
    scripted: float
    random: float
    nearest: float
    any: float
    most: float


def generalize(
    agents: Mapping[int, TrainedAgent],
    cache: Path,
    episodes: int = 100,
    conditions: Sequence[str] = (),
    report: Callable[[str], None] = print,
) -> list[ConditionRow]:
    """Score agents (by seed) under `conditions` (default: all of their design), seed by seed.

    `report` receives a line for each seed and condition. Raises ConfigError for agents of different
    designs or arenas and for an unknown condition.
    """
    design, arena = _one_setting(agents.values())
    benchmark = Benchmark(design=design, arena=arena, episodes=episodes)
    scorer = Scorer(benchmark, cache)
    names = tuple(conditions) or conditions_of(benchmark.design)
    rows: list[ConditionRow] = []
    for condition, (seed, agent) in product(names, agents.items()):
        found = condition_rows(scorer, seed, agent, condition)
        mean = np.mean([row.reward for row in found])
        rows += found
        report(f"{condition}, seed {seed}: {mean:+.3f} per step")
    return rows


def _one_setting(agents: Iterable[TrainedAgent]) -> tuple[Design, ArenaConfig]:
    settings = {(agent.design, agent.arena) for agent in agents}
    if len(settings) != 1:
        found = sorted((design.name, arena.arm, arena.preset) for design, arena in settings)
        raise ConfigError(f"generalization: expected agents of one design and arena, got {found}")
    return settings.pop()


def condition_rows(
    scorer: Scorer, seed: int, agent: TrainedAgent, condition: str
) -> list[ConditionRow]:
    """Score one agent under one condition, RANDOM_WEIGHTS included."""
    agent, drawn_from = acting_under(condition, agent, seed)
    scores = scorer.agent(agent, drawn_from)
    references = [rewards(scorer.reference(name, drawn_from)) for name in (*REFERENCES, *BLIND)]
    return [
        ConditionRow(seed, condition, score.episode, score.program, score.reward_per_step,
                     score.success, score.distance, *map(float, column))
        for score, column in zip(scores, np.transpose(references), strict=True)
    ]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Summary:
    """One condition over all seeds: normalized scores with 95 % intervals."""

    condition: str
    seeds: int
    episodes: int  # of each seed
    reward: float  # per step
    normalized: float
    low: float
    high: float
    worst_seed: float  # normalized
    seeds_above_0_9: int
    success_rate: float
    blind: str  # the best reference that ignores the program
    blind_normalized: float
    gain: float  # over it, normalized
    gain_low: float
    gain_high: float


def summarize(rows: Sequence[ConditionRow]) -> list[Summary]:
    """A summary of each condition, in the order of the rows."""
    names = dict.fromkeys(row.condition for row in rows)
    return [_summary(name, [row for row in rows if row.condition == name]) for name in names]


def _summary(condition: str, rows: Sequence[ConditionRow]) -> Summary:
    seeds = list(dict.fromkeys(row.seed for row in rows))
    # All seeds faced the same episodes, so the references of one seed are those of all.
    one = [row for row in rows if row.seed == seeds[0]]
    scores = np.array([row.reward for row in rows]).reshape(len(seeds), len(one))  # [S, E]
    random, scripted, *blind = (
        np.array([getattr(row, name) for row in one]) for name in ("random", "scripted", *BLIND)
    )
    # The strongest blind reference, so that an agent does not shine beside a weak one.
    best = int(np.argmax([reference.mean() for reference in blind]))
    mean = normalized_interval(scores, random, scripted)
    gain = gain_over(scores, blind[best], random, scripted)
    low, high = float(random.mean()), float(scripted.mean())
    by_seed = np.array([normalized(float(mean), low, high) for mean in scores.mean(axis=1)])
    return Summary(
        condition=condition,
        seeds=len(seeds),
        episodes=len(one),
        reward=float(scores.mean()),
        normalized=mean.mean,
        low=mean.low,
        high=mean.high,
        worst_seed=float(by_seed.min()),
        seeds_above_0_9=int((by_seed >= 0.9).sum()),
        success_rate=float(np.mean([row.success for row in rows])),
        blind=BLIND[best],
        blind_normalized=normalized(float(blind[best].mean()), low, high),
        gain=gain.mean,
        gain_low=gain.low,
        gain_high=gain.high,
    )


def setting(agents: Mapping[int, TrainedAgent], episodes: int) -> dict[str, object]:
    """How a table was made, to be stored beside it as JSON."""
    design, arena = _one_setting(agents.values())
    return {
        "design": design.name,
        "arm": arena.arm,
        "preset": arena.preset,
        "words": design.vocabulary.by_group,  # with the spare ones
        "episodes": episodes,
        "episodes_seed": EPISODES_SEED,
        "agents": {
            seed: {"weights": agent.digest, "version": agent.snapshot.version}
            for seed, agent in agents.items()
        },
        "logic": next(iter(agents.values())).logic.name,
        "device": device(),
        "versions": versions(),
    }
