"""A fault: what is done to a stage, for how long, and what is to be seen of it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from typing import Final, Literal

from chaos.stage import NODES, RECORDER, START_S, Stage

Kind = Literal["learning", "keyed", "launched", "relayed", "executing", "fleet"]
DOWN_S: Final = 3.0  # that a process that ended stays away
STOPPED_S: Final = 5.0
TROUBLE_S: Final = 4.0  # that messages are meddled with, or a second process is there


def _nothing(_: Stage) -> None:
    """Nothing is to be undone."""


@dataclass(frozen=True)
class Fault:
    """`strike`, then `hold_s` later `lift`. `silent`: nobody is expected to say anything of it."""

    name: str
    strike: Callable[[Stage], object]
    lift: Callable[[Stage], object] = _nothing
    hold_s: float = DOWN_S
    kind: Kind = "learning"
    silent: str = ""  # why no node is to say anything; empty: one must
    damages: int = 0  # checkpoints that may be lost by it
    halts: bool = False  # the arm must hold
    goes_on: bool = False  # the learner learns on meanwhile, from another arena
    empties: bool = False  # no process may be left meanwhile
    ready: Callable[[Stage], bool] = lambda _: True  # what is waited for before it


def process_faults() -> list[Fault]:
    """Every process of a graph that learns, killed, stopped, restarted, and started twice."""
    found = []
    for name in (*NODES, RECORDER):
        why = "a recorder says nothing on the graph" if name == RECORDER else ""
        found += [
            Fault(f"{name}: SIGKILL", _signal(name, signal.SIGKILL), _again(name), silent=why),
            Fault(f"{name}: SIGTERM", _signal(name, signal.SIGTERM), _again(name), silent=why),
            Fault(f"{name}: SIGSTOP 5 s", _signal(name, signal.SIGSTOP),
                  _signal(name, signal.SIGCONT), STOPPED_S, silent=why),
            Fault(f"{name}: restart", _again(name), hold_s=0.0, silent=why or "too short"),
            Fault(f"{name}: started twice", _second(name), _no_second(name), TROUBLE_S, silent=why),
        ]  # fmt: skip
    return found


def order_faults() -> list[Fault]:
    """All nodes stopped, and started in another order."""
    return [
        Fault(f"started in order {', '.join(order)}", _in_order(order), hold_s=0.0,
              silent="to wait for each other is no trouble")
        for order in permutations(NODES)
    ]  # fmt: skip


def executing_faults() -> list[Fault]:
    """An agent that stops commanding, by the clock."""
    name = "agent_node"
    return [
        Fault("real time, agent_node: SIGKILL", _signal(name, signal.SIGKILL), _again(name),
              kind="executing", halts=True),
        Fault("real time, agent_node: SIGSTOP 5 s", _signal(name, signal.SIGSTOP),
              _signal(name, signal.SIGCONT), STOPPED_S, kind="executing", halts=True),
    ]  # fmt: skip


def _signal(name: str, number: signal.Signals) -> Callable[[Stage], None]:
    return lambda stage: stage.signal(name, number)


def _again(name: str) -> Callable[[Stage], None]:
    def again(stage: Stage) -> None:
        stage.stop(name)
        stage.start(name)

    return again


def _second(name: str) -> Callable[[Stage], None]:
    def second(stage: Stage) -> None:
        """Start it; it counts from when it is there, or has ended by itself."""
        stage.start(name, beside=True)
        there = stage.count(name) + 1
        stage.until(lambda: stage.count(name) >= there or stage.ended(f"{name}-second"), START_S)

    return second


def _no_second(name: str) -> Callable[[Stage], None]:
    def stop(stage: Stage) -> None:
        stage.stop(f"{name}-second")

    return stop


def _in_order(order: tuple[str, ...]) -> Callable[[Stage], None]:
    def start(stage: Stage) -> None:
        for name in NODES:
            stage.stop(name)
        for name in order:
            stage.start(name)
            stage.wait(1.5)

    return start
