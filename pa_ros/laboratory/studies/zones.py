"""How often formulas hold among zones: trained agents, beside the straight line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from laboratory.studies.tables import read_rows, write_rows
from pa_ros.agents import load_agent
from pa_ros.arena import ReachTask
from pa_ros.arena.zones import FORMULAS
from pa_ros.evaluation.evaluate import EPISODES_SEED
from pa_ros.evaluation.traces import Traces, traces

EPISODES = 128
NUMBERED = [f"formula-{i}" for i in range(1, len(FORMULAS) + 1)]
CONDITIONS = ("reach", "blocked", "blocked-pairs", "non-myopic", *NUMBERED,
              *(f"{name}-blocked" for name, one in zip(NUMBERED, FORMULAS, strict=True)
                if "!" in one))  # fmt: skip


@dataclass(frozen=True, slots=True)
class TracesRow(Traces):
    """Likewise, of one seed."""

    seed: int


def write_traces(path: Path, runs: Mapping[int, Path], episodes: int = EPISODES) -> None:
    """Score the agents of runs (by seed) under CONDITIONS. What is in the table stays."""
    rows = read_rows(path, TracesRow) if path.exists() else []
    for seed in sorted(runs):
        known = {row.condition for row in rows if row.seed == seed}
        if known.issuperset(CONDITIONS):
            continue
        agent = load_agent(runs[seed])
        task = ReachTask(agent.arena, agent.design, EPISODES_SEED)
        straight = {row.condition: row.straight_line_rate for row in rows}
        for condition in CONDITIONS:
            if condition not in known:
                row = traces(task, agent.policy, condition, episodes, straight.get(condition))
                rows.append(TracesRow(**asdict(row), seed=seed))
                print(f"seed {seed}, {condition:17s} {row.success_rate:.2f}")
        write_rows(path, rows)
