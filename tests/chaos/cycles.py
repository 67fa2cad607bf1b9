"""One cycle: a stage that works, a fault, what is seen of it, and whether it works again."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from chaos.faults import Fault
from chaos.invariants import orphans
from chaos.stage import MARK, Stage
from pa_ros.core.errors import PaError

READY_S: Final = 20.0
RECOVER_S: Final = 45.0
SEEN_S: Final = 3.0  # of the design's invariant 12
HELD_RAD: Final = 2e-3  # that an arm which holds may settle by
SETTLE_S: Final = 1.0  # until commands that stopped are noticed
ACCOUNT_S: Final = 5.0  # until nodes, which say it once a second, account for all
BACKLOG_S: Final = 0.5  # in which what waits to be heard is heard
ADVANCE: Final = 5  # versions, or steps, that show work


@dataclass
class Cycle:
    """What came of it. Times in s; None: never."""

    fault: str
    began: float  # wall time
    ended: float = 0.0
    seen_after: float | None = None
    said: str = ""
    recovered_after: float | None = None
    lost: int = 0  # trajectories that nobody accounts for
    mis_joined: int = 0
    failures: list[str] = field(default_factory=list)  # invariants that did not hold


def run_cycle(stage: Stage, fault: Fault) -> Cycle:
    """Strike, watch, lift, watch."""
    stage.until(lambda: fault.ready(stage), READY_S)
    observer, cycle = stage.observer, Cycle(fault.name, time.time())
    stage.until(lambda: _lost(stage) == 0, ACCOUNT_S)
    lost_before, back_before = _lost(stage), observer.went_back
    newest = stage.versions()
    observer.forget()
    struck = time.monotonic()
    try:
        fault.strike(stage)
        struck = time.monotonic()
        version = observer.account.version
        stage.until(_noting(stage, cycle, struck, lambda: False), fault.hold_s)
        if fault.goes_on and observer.account.version <= version + ADVANCE:
            cycle.failures.append(f"others were held up: version {observer.account.version} "
                                  f"{fault.hold_s:g} s after version {version}")  # fmt: skip
        if fault.empties and (left := orphans(stage.mark, MARK)):
            cycle.failures.append(f"processes left behind: {left}")
        if fault.halts:
            _check_held(stage, cycle, struck)
        fault.lift(stage)
        _recover(stage, cycle, struck)
    except (PaError, OSError, LookupError) as error:
        cycle.failures.append(f"{type(error).__name__}: {error}")
    if not fault.silent:
        _check_seen(cycle)
    if stage.learns:
        missing = _lost(stage) - lost_before
        cycle.lost = max(0, missing)
        if missing < 0:
            cycle.failures.append(f"{-missing} trajectories were learned that no agent made")
        if observer.went_back > back_before:
            cycle.failures.append("versions went back")
        _check_checkpoint(stage, cycle, newest, fault.damages)
    cycle.ended = time.time()
    return cycle


def _noting(
    stage: Stage, cycle: Cycle, struck: float, condition: Callable[[], bool]
) -> Callable[[], bool]:
    """The condition, noting on the way when trouble is first seen."""

    def check() -> bool:
        if cycle.seen_after is None and stage.observer.seen is not None:
            at, cycle.said = stage.observer.seen
            cycle.seen_after = max(0.0, at - struck)
        return condition()

    return check


def _recover(stage: Stage, cycle: Cycle, struck: float) -> None:
    """Until all say OK, and work advances, and every trajectory is accounted for."""
    observer, lifted = stage.observer, time.monotonic()
    stage.wait(BACKLOG_S)  # what was published before is not work done since
    learner, version, steps = observer.learner, observer.account.version, observer.steps

    def advanced() -> bool:
        if not stage.learns:
            return observer.steps > steps + ADVANCE
        same = observer.learner is not None and learner is not None
        begun = version if same and observer.learner == learner else 0
        return observer.account.version > begun + ADVANCE

    def works() -> bool:
        return advanced() and observer.all_ok(stage.nodes)

    if stage.until(_noting(stage, cycle, struck, works), RECOVER_S):
        cycle.recovered_after = time.monotonic() - lifted
    else:
        cycle.failures.append(f"not recovered in {RECOVER_S:g} s: {observer.says()}")
        return
    if stage.learns:
        stage.until(lambda: observer.unexplained() == 0, RECOVER_S)  # nodes say it once a second


def _lost(stage: Stage) -> int:
    return stage.observer.unexplained() if stage.learns else 0


def _check_seen(cycle: Cycle) -> None:
    if cycle.seen_after is None:
        cycle.failures.append("no node said anything of it")
    elif cycle.seen_after > SEEN_S:
        cycle.failures.append(f"said only after {cycle.seen_after:.1f} s: {cycle.said}")


def _check_held(stage: Stage, cycle: Cycle, struck: float) -> None:
    moved = stage.observer.moved(struck + SETTLE_S)
    if moved > HELD_RAD:
        cycle.failures.append(f"the arm moved by {moved:.4f} rad while commands had stopped")


def _check_checkpoint(stage: Stage, cycle: Cycle, before: list[int], damages: int) -> None:
    """A learner that began again went on from the newest checkpoint, or `damages` behind it."""
    learner = stage.observer.learner
    if learner is None or learner.stamp_ns < cycle.began * 1e9 or not before:
        return
    newest_allowed = before[min(damages, len(before) - 1)]
    if learner.first_version < newest_allowed:
        cycle.failures.append(
            f"the learner went on from version {learner.first_version}, "
            f"with checkpoints of {before} at hand"
        )
