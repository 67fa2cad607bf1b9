"""Disks that take no more, and checkpoints that are not what was written."""

from __future__ import annotations

import resource
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Final

from chaos.faults import STOPPED_S, Fault
from chaos.stage import RECORDER, Stage
from pa_ros.learning.checkpoint_files import find_checkpoint

LEARNER: Final = "learner_node"
FILES: Final = ("engine.safetensors", "metadata.json", "replay.safetensors")
UNLIMITED: Final = resource.RLIM_INFINITY


def disk_faults() -> list[Fault]:
    """A full disk is made by a limit of the kernel's: no file may grow beyond 0 bytes."""
    return [
        Fault("learner_node: disk full", _full(LEARNER), _free(LEARNER), STOPPED_S),
        Fault("recorder: disk full", _full(RECORDER), _recorder_again, 2.0,
              silent="a recorder says nothing on the graph"),
        *(Fault(f"checkpoint: {name} truncated", _damaged(name, _cut), hold_s=0.0, damages=1,
                ready=_two) for name in FILES),
        *(Fault(f"checkpoint: a bit of {name} flipped", _damaged(name, _flip), hold_s=0.0,
                damages=1, ready=_two) for name in FILES),
    ]  # fmt: skip


def _two(stage: Stage) -> bool:
    """Whether there is a checkpoint to fall back on."""
    return len(stage.versions()) > 1


def _full(name: str) -> Callable[[Stage], object]:
    return lambda stage: resource.prlimit(stage.pid(name), resource.RLIMIT_FSIZE, (0, UNLIMITED))


def _free(name: str) -> Callable[[Stage], object]:
    limits = (UNLIMITED, UNLIMITED)
    return lambda stage: resource.prlimit(stage.pid(name), resource.RLIMIT_FSIZE, limits)


def _recorder_again(stage: Stage) -> None:
    stage.stop(RECORDER)
    stage.start(RECORDER)


def _damaged(name: str, damage: Callable[[Path], None]) -> Callable[[Stage], None]:
    """Stop the learner, damage the newest of its two checkpoints, start it again."""

    def strike(stage: Stage) -> None:
        stage.signal(LEARNER, signal.SIGTERM)
        stage.until(lambda: stage.ended(LEARNER), STOPPED_S)
        stage.stop(LEARNER)
        damage(find_checkpoint(stage.checkpoint) / name)
        stage.start(LEARNER)

    return strike


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) * 2 // 3] ^= 4
    path.write_bytes(bytes(content))
