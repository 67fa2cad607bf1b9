"""Many cycles on a few stages, in rows: one for each fault."""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Final

from pydantic import Field

from chaos.cycles import Cycle, run_cycle
from chaos.faults import Fault, executing_faults, order_faults, process_faults
from chaos.faults_disk import disk_faults
from chaos.faults_fleet import fleet_faults
from chaos.faults_launcher import launcher_faults
from chaos.faults_messages import message_faults
from chaos.invariants import mis_joined, orphans, shared_memory
from chaos.stage import MARK, Stage, executing, fleet, learning, staged, with_key
from chaos.strangers import stranger_faults
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.settings import Settings
from pa_ros.tools.domain import use_domain

SHORT: Final = ("agent_node: SIGKILL", "learner_node: SIGKILL", "sim_node: SIGSTOP 5 s")
ATTEMPTS: Final = 3  # to bring up a stage, on a machine that may be busy
PER_STAGE: Final = 12  # cycles, so that a recording stays short enough to be re-enacted
Say = Callable[[str], None]


class ChaosConfig(Settings):
    """How much harm is done."""

    SECTION: ClassVar[str] = "chaos"

    cycles: int = Field(200, ge=1, description="faults in all, shared among the rows")
    minutes: float = Field(120.0, gt=0, description="begin no cycle after these")
    only: tuple[str, ...] = Field((), description="rows whose name has one of these in it")
    short: bool = Field(False, description="three rows of processes, one cycle each")


@dataclass
class Row:
    """All cycles of one fault."""

    fault: Fault
    cycles: list[Cycle] = field(default_factory=list)

    @property
    def failures(self) -> list[str]:
        """Each cause once."""
        return list(dict.fromkeys(f for cycle in self.cycles for f in cycle.failures))

    @property
    def lost(self) -> int:
        return sum(cycle.lost for cycle in self.cycles)

    @property
    def mis_joined(self) -> int:
        return sum(cycle.mis_joined for cycle in self.cycles)

    @property
    def failed(self) -> bool:
        return bool(self.failures or self.lost or self.mis_joined)

    def median(self, name: str) -> float | None:
        """Of a time over the cycles that have it, s."""
        values = [getattr(cycle, name) for cycle in self.cycles]
        known = [value for value in values if value is not None]
        return statistics.median(known) if known else None


def all_faults() -> list[Fault]:
    """Every row, those of one kind together."""
    return [*process_faults(), *order_faults(), *disk_faults(), *stranger_faults(),
            *launcher_faults(), *message_faults(), *executing_faults(),
            *fleet_faults()]  # fmt: skip


def chosen(config: ChaosConfig) -> list[Fault]:
    """The rows asked for. Raises ConfigError if there are none."""
    if config.short:
        return [fault for fault in all_faults() if fault.name in SHORT]
    names = config.only
    found = [f for f in all_faults() if not names or any(part in f.name for part in names)]
    if not found:
        raise ConfigError(f"chaos.only: expected parts of rows' names, got {names}: no row has one")
    return found


def campaign(config: ChaosConfig, say: Say = print, kept: Path | None = None) -> list[Row]:
    """Do all of it, in a ROS domain of its own; rows as far as they were begun.

    Logs and bags are left in `kept`, if that is given.
    """
    use_domain(None)
    rows = [Row(fault) for fault in chosen(config)]
    deadline = time.monotonic() + config.minutes * 60
    plan = list(_plan(rows, len(rows) if config.short else config.cycles))
    with tempfile.TemporaryDirectory(prefix="pa_ros-chaos-") as made:
        folder = kept or Path(made)
        for number, part in enumerate(_parts(plan)):
            attempts = 0
            while part and time.monotonic() < deadline:
                attempts += 1
                where = folder / f"{number}-{len(part)}-{attempts}"
                if _on_one_stage(where, number, part, deadline, say):
                    attempts = 0
                elif attempts == ATTEMPTS:
                    none = [f"the graph did not come to work, {ATTEMPTS} times, before any harm"]
                    part.pop(0).cycles.append(Cycle("", time.time(), failures=none))
                    attempts = 0
    return rows


def _plan(rows: list[Row], cycles: int) -> Iterator[Row]:
    """As many cycles: all rows in turn, and in each turn kind by kind, so that a campaign that is
    cut short has done every row."""
    kinds = list(dict.fromkeys(row.fault.kind for row in rows))
    turn = sorted(rows, key=lambda row: kinds.index(row.fault.kind))
    yield from itertools.islice(itertools.cycle(turn), cycles)


def _parts(plan: list[Row]) -> Iterator[list[Row]]:
    for _, these in itertools.groupby(plan, key=lambda row: row.fault.kind):
        kept = list(these)
        for begun in range(0, len(kept), PER_STAGE):
            yield kept[begun : begun + PER_STAGE]


def _on_one_stage(folder: Path, number: int, part: list[Row], deadline: float, say: Say) -> bool:
    """Cycles on one graph, as long as it recovers; what was done is taken from `part`.

    False if the graph did not come to work, so that no harm could be done to it.
    """
    kind, memory = part[0].fault.kind, set[Path]()
    parameters = {"executing": executing, "fleet": fleet}.get(kind, learning)()
    if kind == "keyed":
        parameters = with_key(parameters, folder)
    done: list[Cycle] = []
    agents: set[str] = set()
    try:
        with staged(folder, number, parameters, kind) as stage:
            while part and time.monotonic() < deadline:
                row = part.pop(0)
                agents.add(stage.observer.text("agent_node", "agent_id"))
                memory |= shared_memory(stage.mark, MARK)
                row.cycles.append(run_cycle(stage, row.fault))
                agents.add(stage.observer.text("agent_node", "agent_id"))
                memory |= shared_memory(stage.mark, MARK)
                done.append(row.cycles[-1])
                say(_line(done[-1]))
                if done[-1].recovered_after is None:
                    break
    except PaError as error:
        if not done:
            say(str(error))
            return False
        done[-1].failures.append(str(error))
    if done:
        _check_afterwards(stage, done, agents, memory, say)
    return True


def _check_afterwards(
    stage: Stage, done: list[Cycle], agents: set[str], memory: set[Path], say: Say
) -> None:
    """What can be said once the graph is gone."""
    left = orphans(stage.mark, MARK)
    if left:
        done[-1].failures.append(f"processes left behind: {left}")
    if kept := [path.name for path in memory if path.exists()]:
        done[-1].failures.append(f"shared memory left behind: {sorted(kept)}")
    arena = stage.observer.arena
    if stage.learns and arena is not None:
        denied, held = mis_joined(stage.bags, arena, agents - {""})
        say(f"  re-enacted {held} transitions: {len(denied)} trajectories denied")
        for name, stamp_s in denied:
            _culprit(done, stamp_s).mis_joined += 1
            say(f"  {name}")


def _culprit(done: list[Cycle], stamp_s: float) -> Cycle:
    """The cycle in whose time, or after which, something was recorded."""
    return next((c for c in reversed(done) if c.began <= stamp_s), done[0])


def _line(cycle: Cycle) -> str:
    def shown(value: float | None) -> str:
        return "never" if value is None else f"{value:.1f} s"

    what = f"{cycle.fault:<48} seen {shown(cycle.seen_after):>7}  recovered "
    return f"{what}{shown(cycle.recovered_after):>7}  lost {cycle.lost}  " + "; ".join(
        cycle.failures
    )


def failed_rows(rows: Iterable[Row]) -> int:
    """Rows with an invariant that did not hold in some cycle."""
    return sum(row.failed for row in rows)
