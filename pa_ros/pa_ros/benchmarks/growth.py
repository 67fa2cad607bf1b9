"""How the time of an update grows with blocks, batch and programs per transition."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch

from pa_ros.benchmarks.cost import Sizes, floor_us, update_cost
from pa_ros.benchmarks.learner import engine_of, random_learner, repeated
from pa_ros.benchmarks.machine import measure_rates
from pa_ros.benchmarks.rounds import Contender, measure
from pa_ros.core.report import Report
from pa_ros.language import Program
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig


@dataclass(frozen=True)
class Axis:
    """One size that grows while the others stay as in `Sizes()`."""

    name: str
    title: str
    values: tuple[int, ...]

    def sizes(self, value: int) -> Sizes:
        """The batch at one value."""
        if self.name == "blocks":
            return Sizes(objects=value + 1)  # and the hand
        return replace(Sizes(), **{self.name: value})


AXES = (
    Axis("blocks", "blocks", (2, 4, 8, 16)),
    Axis("transitions", "batch (transitions)", (32, 64, 128, 256, 512, 1024)),
    Axis("programs", "programs per transition", (1, 2, 4, 8)),
)
WAYS = ("fused", "torch")
FIGURES = (*WAYS, "floor")  # of each point, in µs


def bench_growth(
    network: NetworkConfig,
    config: LearnerConfig,
    programs: Sequence[Program],
    axes: Sequence[Axis] = AXES,
    rounds: int = 9,
    slice_s: float = 0.1,
) -> Report:
    """µs of one update by the fused code and by torch, one thread each, and of the floor.

    Names are `growth.AXIS.VALUE.FIGURE_us`; all points are measured in the same rounds.
    """
    torch.set_num_threads(1)
    contenders = [
        _contender(network, config, programs, name, sizes, way)
        for name, sizes in points(axes)
        for way in WAYS
    ]
    measure(contenders, rounds, slice_s)
    rates = measure_rates(update_cost(network, Sizes()).bytes)
    measured = {c.name: 1e6 / c.rate for c in contenders}
    report: dict[str, float | int | str] = {}
    for name, sizes in points(axes):
        report |= {key: value for key, value in measured.items() if key.startswith(f"{name}.")}
        report[f"{name}.floor_us"] = floor_us(update_cost(network, sizes), rates)
    return report


def points(axes: Sequence[Axis]) -> Iterator[tuple[str, Sizes]]:
    """Name and batch of each point."""
    for axis in axes:
        for value in axis.values:
            yield f"growth.{axis.name}.{value}", axis.sizes(value)


def series(report: Report, axis: Axis, figure: str) -> list[float]:
    """One figure along an axis, µs."""
    return [float(report[f"growth.{axis.name}.{value}.{figure}_us"]) for value in axis.values]


def markdown_table(report: Report, axes: Sequence[Axis] = AXES) -> str:
    """The report as a table, a row per point."""
    lines = [
        "| | | fused (µs) | torch (µs) | floor (µs) | fused / floor | torch / fused |",
        "|---|---|---|---|---|---|---|",
    ]
    for axis in axes:
        columns = (series(report, axis, figure) for figure in FIGURES)
        for value, fused, eager, floor in zip(axis.values, *columns, strict=True):
            lines.append(
                f"| {axis.title} | {value} | {fused:.0f} | {eager:.0f} | {floor:.0f} "
                f"| {fused / floor:.2f} | {eager / fused:.1f} |"
            )
    return "\n".join(lines)


def _contender(
    network: NetworkConfig,
    config: LearnerConfig,
    programs: Sequence[Program],
    name: str,
    sizes: Sizes,
    way: str,
) -> Contender:
    config = config.changed(
        **{
            "replay.batch_size": sizes.transitions,
            "relabeling.programs_per_transition": sizes.programs,
            "engine.name": way,
            "engine.threads": 1,
        }
    )
    learner = random_learner(network, config, programs, sizes)
    batches = list(learner.batches(4))
    run = repeated(engine_of(learner).update, batches)
    return Contender(f"{name}.{way}_us", run)
