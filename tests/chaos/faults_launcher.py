"""The launcher killed, stopped, restarted and started twice: its nodes are its own."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Final

from chaos.faults import STOPPED_S, Fault, Kind
from chaos.stage import LAUNCHER, RECORDER, START_S, Stage, StageError

SILENT: Final = "a launcher says nothing on the graph"
GONE_S: Final = 45.0  # in which DDS forgets nodes that were killed


def launcher_faults() -> list[Fault]:
    """On a stage whose nodes and recorder `pa_ros launch` has started."""
    kind: Kind = "launched"
    return [
        Fault("launcher: SIGKILL", _signal(signal.SIGKILL), _launch_again, STOPPED_S * 2, kind,
              SILENT, empties=True),
        Fault("launcher: SIGTERM", _signal(signal.SIGTERM), _launch_again, STOPPED_S * 2, kind,
              SILENT, empties=True),
        Fault("launcher: SIGSTOP 5 s", _signal(signal.SIGSTOP), _continue, STOPPED_S, kind, SILENT),
        Fault("launcher: restart", _launch_again, hold_s=0.0, kind=kind, silent=SILENT),
        Fault("launcher: started twice", _second, _no_second, 0.0, kind, SILENT),
        Fault("launched recorder: SIGKILL", _kill_recorder, _launch_again, STOPPED_S * 2, kind,
              SILENT, empties=True),
    ]  # fmt: skip


def _signal(number: signal.Signals) -> Callable[[Stage], None]:
    return lambda stage: stage.signal(LAUNCHER, number)


def _continue(stage: Stage) -> None:
    stage.signal(LAUNCHER, signal.SIGCONT)


def _launch_again(stage: Stage) -> None:
    stage.stop(LAUNCHER)
    stage.until(lambda: not any(stage.count(name) for name in stage.nodes), GONE_S)
    stage.start(LAUNCHER)


def _second(stage: Stage) -> None:
    """Refused by name, since its nodes are there already."""
    second = f"{LAUNCHER}-second"
    stage.start(LAUNCHER, beside=True)
    if not stage.until(lambda: stage.ended(second), START_S):
        raise StageError("launcher: expected a second one to be refused, got one that runs")
    if "already in the graph" not in stage.log(second):
        raise StageError(f"launcher: expected a refusal by name, got {stage.log(second)[-300:]}")


def _no_second(stage: Stage) -> None:
    stage.stop(f"{LAUNCHER}-second")


def _kill_recorder(stage: Stage) -> None:
    """Its launch ends with its name, everything with it."""
    stage.signal(RECORDER, signal.SIGKILL)
    if not stage.until(lambda: stage.ended(LAUNCHER), START_S):
        raise StageError("launcher: expected it to end with its recorder, got one that runs")
    if f"{RECORDER} ended by itself" not in stage.log(LAUNCHER):
        raise StageError(f"launcher: expected the cause, got {stage.log(LAUNCHER)[-300:]}")
