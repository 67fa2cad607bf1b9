"""One cycle: strike a working stage, watch it, lift the fault, and see whether it works again."""

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from chaos.faults import Fault
from chaos.stage import MARK, Stage
from pa_ros.bags.errors import BagError
from pa_ros.bags.experience import TRAJECTORIES
from pa_ros.bags.reader import Bag
from pa_ros.bags.repair import repair
from pa_ros.bags.verify import ArenaReplay
from pa_ros.core.errors import PaError
from pa_ros.core.experience import TrajectoryKey
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.learning import decode_trajectory
from pa_ros.world import Trajectory
from pa_ros.world.world import World

READY_S: Final = 20.0
RECOVER_S: Final = 45.0
REPORT_S: Final = 3.0  # in which a node must report the fault (invariant 12 of the design)
ACCOUNT_S: Final = 5.0  # until nodes, which report once a second, account for all trajectories
BACKLOG_S: Final = 0.5  # in which older messages arrive
ADVANCE: Final = 5  # versions, or steps, that show work
SHARED_MEMORY = Path("/dev/shm")


@dataclass
class Cycle:
    """The result of one cycle. Times in s; None: never."""

    fault: str
    began: float  # wall time
    seen_after: float | None = None
    report: str = ""
    recovered_after: float | None = None
    lost: int = 0  # trajectories that nobody accounts for
    mis_joined: int = 0
    note: str = ""  # what else was measured
    failures: list[str] = field(default_factory=list)  # invariants that did not hold


def run_cycle(stage: Stage, fault: Fault) -> Cycle:
    """Strike, watch, lift, watch."""
    stage.until(lambda: fault.ready(stage), READY_S)
    observer, cycle = stage.observer, Cycle(fault.name, time.time())
    stage.until(lambda: _unexplained(stage) == 0, ACCOUNT_S)
    unexplained, went_back = _unexplained(stage), observer.went_back
    checkpoints = stage.versions()
    observer.forget_reports()
    struck = time.monotonic()
    try:
        fault.strike(stage)
        struck = time.monotonic()
        version = observer.ledger.version
        stage.until(_noting(stage, cycle, struck, lambda: False), fault.hold_s)
        if fault.others_continue and observer.ledger.version <= version + ADVANCE:
            cycle.failures.append(f"others were held up: version {observer.ledger.version} "
                                  f"{fault.hold_s:g} s after version {version}")  # fmt: skip
        if fault.ends_all and (left := orphans(stage.mark)):
            cycle.failures.append(f"processes left behind: {left}")
        if fault.harmless and cycle.report and not stage.stalled:
            cycle.failures.append(f"expected no report of a harmless fault, got {cycle.report}")
        if fault.halts or fault.rests:
            unrest = stage.unrest(struck, fault.halts)
            cycle.failures += [unrest] if unrest else []
        fault.lift(stage)
        _recover(stage, cycle, struck)
        if not fault.silent:  # all may be well again before a node's next report, once a second
            seen = _noting(stage, cycle, struck, lambda: cycle.seen_after is not None)
            stage.until(seen, struck + REPORT_S - time.monotonic())
    except (PaError, OSError, LookupError) as error:
        cycle.failures.append(f"{type(error).__name__}: {error}")
    if not fault.silent and cycle.seen_after is None:
        cycle.failures.append("no node reported it")
    elif not fault.silent and cycle.seen_after is not None and cycle.seen_after > REPORT_S:
        cycle.failures.append(f"reported only after {cycle.seen_after:.1f} s: {cycle.report}")
    cycle.note, harm = stage.harm()
    cycle.failures += harm
    if stage.learns:
        missing = _unexplained(stage) - unexplained
        cycle.lost = max(0, missing)
        if missing < 0:
            cycle.failures.append(f"{-missing} trajectories were learned that no agent made")
        if observer.went_back > went_back:
            cycle.failures.append("versions went back")
        _check_resumed(stage, cycle, checkpoints, fault.damages)
    return cycle


def _noting(
    stage: Stage, cycle: Cycle, struck: float, condition: Callable[[], bool]
) -> Callable[[], bool]:
    """The condition; evaluating it also notes when trouble is first reported."""

    def check() -> bool:
        if cycle.seen_after is None and stage.observer.first_report is not None:
            at, cycle.report = stage.observer.first_report
            cycle.seen_after = max(0.0, at - struck)
        return condition()

    return check


def _recover(stage: Stage, cycle: Cycle, struck: float) -> None:
    """Wait until all nodes report OK, work advances, and every trajectory is accounted for."""
    observer, lifted = stage.observer, time.monotonic()
    stage.wait(BACKLOG_S)  # what was published before shows no work
    learner, version, steps = observer.learner, observer.ledger.version, stage.progress

    def works() -> bool:
        if stage.learns:
            same = observer.learner is not None and observer.learner == learner
            advanced = observer.ledger.version > (version if same else 0) + ADVANCE
        else:
            advanced = stage.progress > steps + ADVANCE
        return advanced and observer.all_ok(stage.nodes)

    if not stage.until(_noting(stage, cycle, struck, works), RECOVER_S):
        cycle.failures.append(f"not recovered in {RECOVER_S:g} s: {observer.summary()}")
        return
    cycle.recovered_after = time.monotonic() - lifted
    stage.until(lambda: _unexplained(stage) == 0, RECOVER_S)


def _unexplained(stage: Stage) -> int:
    return stage.observer.unexplained() if stage.learns else 0


def _check_resumed(stage: Stage, cycle: Cycle, checkpoints: list[int], damages: int) -> None:
    """A restarted learner must resume from the newest checkpoint, or `damages` before it."""
    learner = stage.observer.learner
    if learner is None or learner.stamp_ns < cycle.began * 1e9 or not checkpoints:
        return
    if learner.first_version < checkpoints[min(damages, len(checkpoints) - 1)]:
        cycle.failures.append(
            f"the learner resumed version {learner.first_version}, although there were checkpoints "
            f"of {checkpoints}"
        )


def mis_joined(
    bags: Iterable[Path], arena: ArenaDescription, agents: set[str]
) -> tuple[list[tuple[str, float]], int]:
    """Recorded trajectories of these agents that a fresh arena, replaying them, contradicts.

    Returns their names with the times at which they were recorded (s), and the number of
    transitions compared. A recording that was killed is repaired first.
    """
    replay, wrong, known = ArenaReplay(arena), list[tuple[str, float]](), set[TrajectoryKey]()
    for folder in bags:
        try:
            found = list(_trajectories(folder, arena.world))
        except BagError:
            try:
                repair(folder)
                found = list(_trajectories(folder, arena.world))
            except BagError:
                continue  # it was killed before anything was written
        for trajectory, stamp_s in found:
            if trajectory.key not in known and trajectory.agent_id in agents:
                known.add(trajectory.key)
                name = replay.check(trajectory)
                wrong += [(name, stamp_s)] if name is not None else []
    return wrong, replay.checked


def _trajectories(folder: Path, world: World) -> Iterable[tuple[Trajectory, float]]:
    with Bag(folder) as bag:
        for recorded in bag.messages([bag.topic_of(TRAJECTORIES)]):
            message = bag.deserialize(recorded)
            try:
                trajectory = decode_trajectory(message, world)
            except PaError:
                continue  # a forged one
            yield trajectory, recorded.stamp_ns / 1e9


def orphans(mark: str) -> list[int]:
    """Living processes with the mark in their environment."""
    wanted = f"{MARK}={mark}".encode()
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal() and int(entry.name) != os.getpid():
            try:
                if wanted in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
            except OSError:
                continue  # it ended, or belongs to another user
    return found


def shared_memory(mark: str) -> set[Path]:
    """Shared memory that living processes with the mark in their environment have mapped.

    Without the page of LTTng, which ROS's tracing creates once for each user.
    """
    found: set[Path] = set()
    for process in orphans(mark):
        try:
            maps = Path(f"/proc/{process}/maps").read_text()
        except OSError:
            continue  # it ended
        words = (line.split() for line in maps.splitlines())
        paths = (Path(word[5]) for word in words if len(word) == 6)
        mapped = (path for path in paths if not path.name.startswith("lttng-ust-wait"))
        found.update(path for path in mapped if SHARED_MEMORY in path.parents)
    return found
