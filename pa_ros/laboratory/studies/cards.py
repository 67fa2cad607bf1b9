"""Model cards: what an agent is, in YAML that model hubs read, and its measured scores."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from laboratory.studies.generalization_figures import in_words
from pa_ros.agents import load_agent
from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import read_json
from pa_ros.core.text import Report
from pa_ros.evaluation.conditions import RANDOM_WEIGHTS
from pa_ros.learning.checkpoints import read_metadata

SHIPPED = {"eval": "held_out", "train": "train"}  # conditions, as `pa_ros ship` names them
SCORES = ("normalized", "success_rate")


def model_card(path: str | Path, report: Report | None = None) -> str:
    """The card of a checkpoint, in Markdown with YAML before it.

    `report` is what `pa_ros eval --condition all --json FILE` wrote for these weights; without it
    the scores are those that `pa_ros ship` measured. Raises ConfigError for a report of other
    weights, or if nothing was measured.
    """
    agent, values = load_agent(path), read_metadata(Path(path))
    facts = values["extra"]
    if report is not None and report.get("eval.weights") != agent.digest:
        raise ConfigError(
            f"card: expected scores of the weights {agent.digest}, got those of "
            f"{report.get('eval.weights')}: measure {path} with pa_ros eval --condition all --json"
        )
    source: Mapping[str, Any] = facts if report is None else report
    rows = _rows(source)
    if not rows:
        raise ConfigError(
            f"card: expected measured scores, got none: run pa_ros eval --checkpoint {path} "
            "--condition all --json FILE, then give --scores FILE"
        )
    episodes = source["episodes" if report is None else "eval.episodes"]
    words = agent.design.vocabulary
    name = f"{agent.design.name}-{agent.arena.arm}-{agent.arena.preset}"
    name += "-camera" if agent.perception else ""
    table = "".join(f"| {in_words(condition)} | {_cells(scores)} |\n" for condition, scores in rows)
    return _TEXT.format(
        name=name,
        design=agent.design.name,
        metrics="".join(_metrics(*row) for row in rows if row[0] in SHIPPED),
        arm=agent.arena.arm,
        preset=agent.arena.preset,
        words=", ".join(words.words),
        relations=", ".join(words.relations),
        does=agent.design.skill.does,
        sees=" It sees blocks through a camera." if agent.perception else "",
        table=table,
        episodes=episodes,
        versions=source["versions"],
        frames=values["counters"]["frames"],
        seed=facts.get("seed"),
        algorithm=values["algorithm"],
        count=len(values["programs"]),
        weights=agent.digest,
    )


def read_report(path: Path) -> dict[str, Any]:
    """A report that `pa_ros eval --json` wrote; ConfigError for any other file."""
    try:
        return dict(read_json(path.read_text()))
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(f"{path}: expected a report of pa_ros eval --json: {error}") from error


def _rows(source: Mapping[str, Any]) -> list[tuple[str, dict[str, float]]]:
    """Scores by condition, in the order of the source."""
    shipped = {
        condition: {score: source[f"{name}.{score}"]}
        for condition, name in SHIPPED.items()
        for score in SCORES
        if f"{name}.{score}" in source
    }
    found: dict[str, dict[str, float]] = {}
    for key, value in source.items():
        named = re.fullmatch(r"eval\.([\w-]+)\.(normalized|low|high|success_rate)", key)
        if named and named[1] != RANDOM_WEIGHTS:  # those are not the agent's
            found.setdefault(named[1], {})[named[2]] = float(value)
    return [*(found or shipped).items()]


def _metrics(condition: str, scores: Mapping[str, float]) -> str:
    """A condition's scores as a hub reads them, each on one line of YAML."""
    return "".join(
        f'    - {{type: {kind}, name: "{in_words(condition)}", value: {scores[kind]:.4g}}}\n'
        for kind in SCORES
        if kind in scores
    )


def _cells(scores: Mapping[str, float]) -> str:
    own = f"{scores['normalized']:.2f}" if "normalized" in scores else "–"
    if "low" in scores:
        own += f" [{scores['low']:.2f}, {scores['high']:.2f}]"
    return f"{own} | {scores['success_rate']:.0%}" if "success_rate" in scores else f"{own} | –"


_TEXT = """---
license: apache-2.0
library_name: programmable-agents
pipeline_tag: reinforcement-learning
tags: [robotics, ros2, mujoco, programmable-agents]
model-index:
- name: {name}
  results:
  - task: {{type: reinforcement-learning}}
    dataset: {{type: simulation, name: {design}}}
    metrics:
{metrics}---
# {name}

A programmable agent (Denil et al. 2017) for the simulated arm `{arm}` with the preset `{preset}`.
It executes programs over the words {words} and the relations {relations}. It {does}.{sees}
It was trained for {frames:,} frames by {algorithm}, seed {seed}, under {count} programs, which
`metadata.json` lists; its weights are {weights}. It was not tried on a real arm.

A score is the reward per step, 0 for a random policy and 1 for a script that knows the target, with
a 95 % interval. *Satisfied* is the share of episodes that end so. Each row has {episodes} episodes
that were not used in training, in simulation, with {versions}.
The project's docs/arena.md says what each row draws.

| Programs | Score | Satisfied |
| --- | --- | --- |
{table}
`pa_ros.load(PATH)` loads this folder; `pa_ros export PATH --onnx FILE` writes an ONNX file.
"""
