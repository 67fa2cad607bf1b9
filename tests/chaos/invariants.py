"""What must hold after any fault, checked from outside the graph."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import partial
from pathlib import Path

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

SHARED_MEMORY = Path("/dev/shm")
LTTNG = "lttng-ust-wait"


def mis_joined(
    bags: Iterable[Path], arena: ArenaDescription, ours: set[str]
) -> tuple[list[tuple[str, float]], int]:
    """Recorded trajectories of agents of ours that a fresh arena denies, and when they came, s;
    and how many transitions it was asked about.

    A recording that was killed is repaired first.
    """
    reenactment, denied = ArenaReplay(arena), list[tuple[str, float]]()
    for trajectory, stamp_s in _trajectories(bags, arena.world):
        if trajectory.agent_id in ours:
            name = reenactment.check(trajectory)
            denied += [(name, stamp_s)] if name is not None else []
    return denied, reenactment.checked


def _trajectories(bags: Iterable[Path], world: World) -> Iterable[tuple[Trajectory, float]]:
    """Of all bags, each once, in the order recorded."""
    known: set[TrajectoryKey] = set()
    for folder in bags:
        try:
            with Bag(folder) as bag:
                yield from _once(bag, world, known)
        except BagError:
            try:
                repair(folder)
                with Bag(folder) as bag:
                    yield from _once(bag, world, known)
            except BagError:
                continue  # nothing was in it yet


def _once(bag: Bag, world: World, known: set[TrajectoryKey]) -> Iterable[tuple[Trajectory, float]]:
    decode = partial(decode_trajectory, world=world)
    for recorded in bag.messages([bag.topic_of(TRAJECTORIES)]):
        try:
            trajectory = decode(bag.deserialize(recorded))
        except BagError:
            raise
        except PaError:
            continue  # a stranger's
        if trajectory.key not in known:
            known.add(trajectory.key)
            yield trajectory, recorded.stamp_ns / 1e9


def orphans(mark: str, variable: str) -> list[int]:
    """Processes that still live and have the mark in their environment."""
    wanted = f"{variable}={mark}".encode()
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal() and int(entry.name) != os.getpid():
            try:
                if wanted in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
            except OSError:
                continue  # it ended, or is another's
    return found


def shared_memory(mark: str, variable: str) -> set[Path]:
    """Shared memory that living processes with the mark in their environment have mapped, but for
    LTTng's, which ROS's tracing brings along: one page for each user, and it is to stay."""
    found: set[Path] = set()
    for process in orphans(mark, variable):
        try:
            maps = Path(f"/proc/{process}/maps").read_text()
        except OSError:
            continue  # it ended
        words = (line.split() for line in maps.splitlines())
        paths = (Path(word[5]) for word in words if len(word) == 6)
        ours = (path for path in paths if not path.name.startswith(LTTNG))
        found.update(path for path in ours if SHARED_MEMORY in path.parents)
    return found
