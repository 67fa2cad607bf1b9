"""What relations are worth and cost: references of each, and updates that mix several."""

from __future__ import annotations

from collections.abc import Callable

from pa_ros.arena import (
    PRESETS,
    ReachTask,
    design_named,
    mean_reward,
    random_policy,
    scripted_action,
    training_programs,
    world_of,
)
from pa_ros.benchmarks.cost import Sizes
from pa_ros.benchmarks.learner import engine_of, random_learner, repeated
from pa_ros.benchmarks.rounds import Contender, measure
from pa_ros.core.report import Report
from pa_ros.learning.learner import Learner
from pa_ros.learning.protocols import protocol_named
from pa_ros.world.relations import RELATIONS

DESIGN, PROTOCOL = "2-L", "ours"
MIXTURES = {  # names of what is compared: relations of the world
    "near": ("NEAR",),
    "above": ("ABOVE",),
    "2_relations": ("NEAR", "ABOVE"),
    "6_relations": ("NEAR", "ABOVE", "LEFT_OF", "RIGHT_OF", "BEHIND", "IN_FRONT_OF"),
}
ENGINES = ("fused", "torch")


def bench_relations(episodes: int = 100, rounds: int = 15, slice_s: float = 0.25) -> Report:
    """`pa_ros bench relations`: both, and the references as a table on standard output."""
    report = {**references(episodes), **updates(rounds, slice_s)}
    print(markdown_table(report))
    return report


def references(episodes: int) -> dict[str, float]:
    """Reward per step of script and of chance, for each relation and preset."""
    report = {}
    for preset, config in PRESETS.items():
        for relation in RELATIONS:
            task = ReachTask(config, design_named(DESIGN).with_relations(relation), seed=0)
            name = f"relation.{relation}.{preset}"
            report[f"{name}.scripted"] = mean_reward(task, scripted_action, episodes)
            report[f"{name}.random"] = mean_reward(task, random_policy(0), episodes)
    return report


def updates(rounds: int, slice_s: float) -> dict[str, float]:
    """Updates per second of batches whose programs ask for one relation, or several."""
    contenders = [
        Contender(f"updates_per_s.{engine}.{name}", _updates(relations, engine))
        for engine in ENGINES
        for name, relations in MIXTURES.items()
    ]
    measure(contenders, rounds, slice_s)
    rates = {one.name: one.rate for one in contenders}
    ratios = {
        f"price.{engine}.{name}": rates[f"updates_per_s.{engine}.above"] / rate
        for engine in ENGINES
        for name in MIXTURES
        if (rate := rates[f"updates_per_s.{engine}.{name}"])
    }
    return rates | ratios


def _updates(relations: tuple[str, ...], engine: str) -> Callable[[int], object]:
    learner = _learner(relations)
    return repeated(engine_of(learner, name=engine).update, list(learner.batches(16)))


def _learner(relations: tuple[str, ...]) -> Learner:
    """With random experience under all training programs."""
    design, protocol = design_named(DESIGN).with_relations(*relations), protocol_named(PROTOCOL)
    network = protocol.network_config(world_of(PRESETS["fast"], design), "programmable")
    config = protocol.learner
    sizes = Sizes(config.replay.batch_size, 5, config.relabeling.programs_per_transition)
    return random_learner(network, config, training_programs(design), sizes)


def markdown_table(report: Report) -> str:
    """Of the references: a row for each relation."""
    columns = [(preset, who) for preset in PRESETS for who in ("scripted", "random")]
    lines = [
        "| relation | holds where | threshold | "
        + " | ".join(f"{preset}, {who}" for preset, who in columns) + " |",
        "|---|---|---" + "|---" * len(columns) + "|",
    ]  # fmt: skip
    for name in RELATIONS:
        relation = RELATIONS[name]
        cells = [f"{report[f'relation.{name}.{p}.{who}']:.3f}" for p, who in columns]
        threshold = f"{relation.threshold:.3g} {relation.unit}"
        lines.append(f"| `{name}` | {relation.meaning} | {threshold} | {' | '.join(cells)} |")
    return "\n".join(lines)
