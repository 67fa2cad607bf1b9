"""A graph that learns while its nodes are killed, and whether every trajectory is accounted for."""

from __future__ import annotations

import itertools
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from chaos.cycles import READY_S, RECOVER_S
from chaos.faults import DOWN_S
from chaos.stage import NODES, Stage, staged
from pa_ros.tools.domain import use_free_domain

EVERY_S: Final = 20.0  # between two kills


def soak(seconds: float, kept: Path | None, log: Callable[[str], None] = print) -> bool:
    """Kill -9 one node after the other, every EVERY_S; whether the accounts close at the end.

    Every trajectory that was accounted for was learned, rejected, or is reported lost; the others
    are in flight, or were lost with an agent that was killed.
    """
    use_free_domain()
    with tempfile.TemporaryDirectory(prefix="pa_ros-soak-") as made:
        with staged((kept or Path(made)) / "soak", 0, "learning", Stage) as stage:
            ends_at, kills = time.monotonic() + seconds, 0
            for name in itertools.cycle(NODES):
                if time.monotonic() + EVERY_S > ends_at:
                    break
                stage.signal(name, signal.SIGKILL)
                kills += 1
                stage.wait(DOWN_S)
                stage.stop(name)
                stage.start(name)
                stage.wait(EVERY_S - DOWN_S)
                log(f"kill {kills}, {name}: {_account(stage)}")
            recovered = stage.until(lambda: stage.observer.all_ok(stage.nodes), READY_S + RECOVER_S)
            closed = stage.until(lambda: stage.observer.unexplained() == 0, RECOVER_S)
            log(f"after {kills} kills: {_account(stage)}; all nodes OK: {recovered}")
    return recovered and closed


def _account(stage: Stage) -> str:
    observer = stage.observer
    accounted, learned = observer.ledger.accounted, observer.ledger.version
    lost, rejected, missing = (
        int(observer.value("learner_node", f"{name}_trajectories"))
        for name in ("lost", "rejected", "missing")
    )
    return (
        f"{accounted} accounted for = {learned} learned + {lost} lost + {rejected} rejected + "
        f"{accounted - learned - lost - rejected} nowhere; {missing} missing"
    )
