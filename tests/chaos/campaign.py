"""Many cycles on a few stages, as a table with a row for each fault."""

import itertools
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from chaos import faults, messages, robot, services, sight
from chaos.cycles import Cycle, mis_joined, orphans, run_cycle, shared_memory
from chaos.faults import Fault
from chaos.stage import Stage, staged
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.tools.domain import use_free_domain

SHORT: Final = ("agent_node: SIGKILL", "learner_node: SIGKILL", "sim_node: SIGSTOP 5 s")
STAGES: Final[dict[str, type[Stage]]] = {"robot": robot.Rig, "sighted": sight.Sighted}
PER_STAGE: Final = 12  # cycles, so that a recording stays short enough to be replayed
TABLE = ("<!-- make chaos -->\n", "<!-- end -->\n")  # the table in FAULTS.md lies between these
HEAD = """| Fault | Reported, s | Recovered, s |
|---|---|---|
"""


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
        """The median of a time over the cycles that have it, s."""
        values = [getattr(cycle, name) for cycle in self.cycles]
        known = [value for value in values if value is not None]
        return statistics.median(known) if known else None


def all_faults() -> list[Fault]:
    """Every fault, those of one kind together."""
    return [*faults.process_faults(), *faults.order_faults(), *faults.disk_faults(),
            *messages.stranger_faults(), *faults.launcher_faults(), *messages.relay_faults(),
            *services.service_faults(), *faults.executing_faults(),
            *faults.fleet_faults(), *faults.extension_faults(), *sight.sight_faults(),
            *robot.robot_faults()]  # fmt: skip


def chosen(only: Sequence[str] = (), short: bool = False) -> list[Fault]:
    """The faults whose name contains one of `only` (default: all). Raises ConfigError for none."""
    if short:
        return [fault for fault in all_faults() if fault.name in SHORT]
    found = [f for f in all_faults() if not only or any(part in f.name for part in only)]
    if not found:
        raise ConfigError(f"--only: expected parts of faults' names, got {only}")
    return found


def campaign(
    wanted: Sequence[Fault],
    cycles: int,
    kept: Path | None = None,
    log: Callable[[str], None] = print,
) -> list[Row]:
    """Run so many cycles; faults take turns. Logs and bags are left in `kept`, if it is given."""
    use_free_domain()
    rows = [Row(fault) for fault in wanted]
    with tempfile.TemporaryDirectory(prefix="pa_ros-chaos-") as made:
        for number, part in enumerate(_parts(rows, cycles)):
            while part:
                _on_one_stage((kept or Path(made)) / f"{number}-{len(part)}", number, part, log)
    return rows


def _parts(rows: list[Row], cycles: int) -> Iterator[list[Row]]:
    """The rows of each cycle, in parts that one stage can serve.

    All rows take turns, and within a turn kind by kind, so that a campaign that ends early has done
    every row.
    """
    kinds = list(dict.fromkeys(row.fault.kind for row in rows))
    turn = sorted(rows, key=lambda row: kinds.index(row.fault.kind))
    plan = itertools.islice(itertools.cycle(turn), cycles)
    for _, group in itertools.groupby(plan, key=lambda row: row.fault.kind):
        same = list(group)
        for begun in range(0, len(same), PER_STAGE):
            yield same[begun : begun + PER_STAGE]


def _on_one_stage(folder: Path, number: int, part: list[Row], log: Callable[[str], None]) -> None:
    """Run cycles on one graph as long as it recovers, and remove them from `part`."""
    done: list[Cycle] = []
    agents: set[str] = set()
    memory: set[Path] = set()
    kind = part[0].fault.kind
    try:
        with staged(folder, number, kind, STAGES.get(kind, Stage)) as stage:

            def note() -> None:
                agents.add(stage.observer.text("agent_node", "agent_id"))
                memory.update(shared_memory(stage.mark))

            while part and (not done or done[-1].recovered_after is not None):
                row = part.pop(0)
                note()
                done.append(run_cycle(stage, row.fault))
                row.cycles.append(done[-1])
                note()
                log(_line(done[-1]))
    except PaError as error:
        if not done:  # the graph did not start
            part.pop(0).cycles.append(Cycle("", time.time(), failures=[str(error)]))
            return
        done[-1].failures.append(str(error))
    _check_afterwards(stage, done, agents, memory, log)


def _check_afterwards(
    stage: Stage, done: list[Cycle], agents: set[str], memory: set[Path], log: Callable[[str], None]
) -> None:
    """What can be checked once the graph has ended."""
    if left := orphans(stage.mark):
        done[-1].failures.append(f"processes left behind: {left}")
    if kept := sorted(path.name for path in memory if path.exists()):
        done[-1].failures.append(f"shared memory left behind: {kept}")
    arena = stage.observer.arena
    if stage.learns and arena is not None:
        wrong, compared = mis_joined(stage.bags, arena, agents - {""})
        log(f"  replayed {compared} transitions: {len(wrong)} trajectories contradicted")
        for name, stamp_s in wrong:
            # It belongs to the cycle during or after which it was recorded.
            next((c for c in reversed(done) if c.began <= stamp_s), done[0]).mis_joined += 1
            log(f"  {name}")


def _line(cycle: Cycle) -> str:
    seen, recovered = (
        "never" if value is None else f"{value:.1f} s"
        for value in (cycle.seen_after, cycle.recovered_after)
    )
    return (f"{cycle.fault:<48} reported {seen:>7}  recovered {recovered:>7}  lost {cycle.lost}  "
            + "; ".join([*cycle.failures, *([cycle.note] if cycle.note else [])]))  # fmt: skip


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Rewrite the table between the markers of a page; a row for each fault that was injected, and
    the rows of the others as they were."""
    before, _, rest = path.read_text().partition(TABLE[0])
    old, _, after = rest.partition(TABLE[1])
    places = {fault.name: i for i, fault in enumerate(all_faults())}
    for row in rows:
        places.setdefault(row.fault.name, len(places))
    injected = [(places[row.fault.name], _cells(row)) for row in rows if row.cycles]
    done = {place for place, _ in injected}
    kept = [(places.get(_name(line), -1), line) for line in old.splitlines(keepends=True)]
    lines = injected + [(place, line) for place, line in kept if place not in {-1, *done}]
    table = HEAD + "".join(line for _, line in sorted(lines, key=lambda entry: entry[0]))
    path.write_text(before + TABLE[0] + table + TABLE[1] + after)


def _name(line: str) -> str:
    """The fault of a row of the table."""
    return line.removeprefix("| ").partition(" |")[0].partition(" **failed**")[0]


def _cells(row: Row) -> str:
    harm = [f"{row.lost} trajectories lost"] if row.lost else []
    harm += [f"{row.mis_joined} trajectories mis-joined"] if row.mis_joined else []
    failures = "; ".join([*harm, *row.failures[:3]])
    seen, recovered = row.median("seen_after"), row.median("recovered_after")
    cells = (
        f"{row.fault.name} **failed**: {failures}" if failures else row.fault.name,
        "–" if seen is None else f"{seen:.1f}",
        "never" if recovered is None else f"{recovered:.1f}",
    )
    return "| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |\n"
