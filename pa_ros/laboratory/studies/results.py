"""Studies of trained agents and of variants: run one, and write its table and picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from laboratory.studies.detectors import Accuracy, detector_table
from laboratory.studies.equalities import Difference, difference_table
from laboratory.studies.generalization import ConditionRow, Summary, generalize, setting, summarize
from laboratory.studies.generalization_figures import detector_figure, generalization_figure
from laboratory.studies.learning_figures import variants_figure
from laboratory.studies.tables import read_rows, read_setting, write_rows, write_setting
from laboratory.studies.variants import compare
from pa_ros.agents import TrainedAgent

EQUALITY_EPISODES, DETECTOR_EPISODES = 30, 50

Agents = Mapping[int, TrainedAgent]


def generalization(
    agents: Agents,
    folder: Path,
    cache: Path,
    episodes: int = 100,
    suffix: str = "",
    report: Callable[[str], None] = print,
    conditions: Sequence[str] = (),
) -> list[Summary]:
    """Score agents (by seed) under `conditions` (default: all).

    Writes `generalization{suffix}.csv`, `.json`, `.png` and `-summary.csv`. Scores are stored under
    `cache`, so that an interrupted call can continue. Raises ConfigError unless the agents share
    design and arena.
    """
    rows = generalize(agents, cache, episodes, conditions, report)
    summaries = summarize(rows)
    table = folder / f"generalization{suffix}.csv"
    _write(table, rows, agents, episodes)
    write_rows(folder / f"generalization-summary{suffix}.csv", summaries)
    redraw_generalization(table)
    return summaries


def redraw_generalization(table: Path) -> Path:
    """Draw the picture of a table that `generalization` wrote; returns its path."""
    rows = read_rows(table, ConditionRow)
    facts = read_setting(table, "design", "preset", "agents", "episodes")
    picture = table.with_suffix(".png")
    generalization_figure(
        picture,
        rows,
        f"{facts['design']}, {facts['preset']} preset: zero-shot performance of "
        f"{len(facts['agents'])} agents, {facts['episodes']} episodes each",
    )
    return picture


def equalities(
    agents: Agents, folder: Path, episodes: int = EQUALITY_EPISODES, suffix: str = ""
) -> list[Difference]:
    """Compare logically equal programs; writes `equalities{suffix}.csv` and `.json`."""
    rows = difference_table(agents, episodes)
    _write(folder / f"equalities{suffix}.csv", rows, agents, episodes)
    return rows


def detectors(
    agents: Agents, folder: Path, episodes: int = DETECTOR_EPISODES, suffix: str = ""
) -> list[Accuracy]:
    """Judge detectors; writes `detectors{suffix}.csv`, `.json`, and a `.png` of the first agent."""
    rows = detector_table(agents, episodes)
    table = folder / f"detectors{suffix}.csv"
    _write(table, rows, agents, episodes)
    seed, agent = next(iter(agents.items()))
    title = (
        f"{agent.design.name}, {agent.arena.preset} preset, seed {seed}: learned detectors where "
        f"they do best and worst in {episodes} episodes"
    )
    detector_figure(table.with_suffix(".png"), agent, episodes, title)
    return rows


def write_variants(name: str, results: Path) -> Path:
    """Write `NAME-variants.csv` and its picture in `results`; returns the table's path."""
    rows, seeds = compare(name, results)
    path = results / f"{name}-variants.csv"
    write_rows(path, rows)
    variants_figure(path.with_suffix(".png"), rows, seeds)
    return path


def write_algorithms(name: str, results: Path) -> Path:
    """Write `NAME-algorithms.csv`; returns the table's path."""
    rows, _ = compare(name, results, by="algorithm")
    path = results / f"{name}-algorithms.csv"
    write_rows(path, rows)
    return path


def _write(table: Path, rows: Sequence[Any], agents: Agents, episodes: int) -> None:
    """Write a table, and how it was made beside it."""
    write_rows(table, rows)
    write_setting(table, setting(agents, episodes))
