"""One arena of two that feed one learner: away, late, slow, back; and the learner that dies."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Final

from chaos.faults import DOWN_S, STOPPED_S, Fault
from chaos.stage import Stage

ARENA: Final = ("sim_node", "agent_node")
OTHER: Final = ("arena2/sim_node", "arena2/agent_node")


def fleet_faults() -> list[Fault]:
    """Done to the arena in the learner's namespace; the other one must go on."""
    return [
        Fault("fleet, an arena dies and comes back under its name", _each(ARENA, _kill),
              _each(ARENA, _again), DOWN_S, "fleet", goes_on=True),
        Fault("fleet, an arena lags: its sim_node SIGSTOP 5 s", _signal("sim_node", signal.SIGSTOP),
              _signal("sim_node", signal.SIGCONT), STOPPED_S, "fleet", goes_on=True),
        Fault("fleet, an arena lags: its agent_node SIGSTOP 5 s",
              _signal("agent_node", signal.SIGSTOP), _signal("agent_node", signal.SIGCONT),
              STOPPED_S, "fleet", goes_on=True),
        Fault("fleet, an agent comes back under its name at once", _again_after_kill("agent_node"),
              hold_s=DOWN_S, kind="fleet", silent="it begins an account of its own",
              goes_on=True),
        Fault("fleet, the other arena joins late", _late, hold_s=0.0, kind="fleet",
              silent="to come late is no trouble"),
        Fault("fleet, the learner dies: SIGKILL", _signal("learner_node", signal.SIGKILL),
              _each(("learner_node",), _again), DOWN_S, "fleet"),
    ]  # fmt: skip


def _each(names: tuple[str, ...], deed: Callable[[Stage, str], object]) -> Callable[[Stage], None]:
    def do(stage: Stage) -> None:
        for name in names:
            deed(stage, name)

    return do


def _kill(stage: Stage, name: str) -> None:
    stage.signal(name, signal.SIGKILL)


def _again(stage: Stage, name: str) -> None:
    stage.stop(name)
    stage.start(name)


def _signal(name: str, number: signal.Signals) -> Callable[[Stage], None]:
    return lambda stage: stage.signal(name, number)


def _again_after_kill(name: str) -> Callable[[Stage], None]:
    def deed(stage: Stage) -> None:
        _kill(stage, name)
        _again(stage, name)

    return deed


def _late(stage: Stage) -> None:
    """Stopped, missed for a while by nobody, and there again as another incarnation."""
    for name in OTHER:
        stage.stop(name)
    stage.wait(DOWN_S)
    for name in OTHER:
        stage.start(name)
