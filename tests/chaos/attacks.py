"""Random faults of robot_node in random order, in each control mode: `make chaos ARGS=--robot`."""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from chaos.arm import Record
from chaos.cycles import Cycle, run_cycle
from chaos.robot import Rig, robot_faults
from chaos.stage import staged
from pa_ros.tools.domain import use_free_domain

CONTROLS: Final = ("velocity", "joint_trajectory", "joint_jog")
LONGEST_S: Final = 5.0  # of a fault
PAUSE_S: Final = 2.0  # the longest one before a fault


def attack(
    minutes: float, seed: int, kept: Path | None = None, log: Callable[[str], None] = print
) -> bool:
    """Attack robot_node for so long; whether the arm did nothing that it must not do."""
    use_free_domain()
    chance, worst, done = random.Random(seed), Record(), list[Cycle]()
    with tempfile.TemporaryDirectory(prefix="pa_ros-attacks-") as made:
        for number, control in enumerate(CONTROLS, 1):
            ends_at = time.monotonic() + minutes * 60 / len(CONTROLS)
            while time.monotonic() < ends_at:
                folder = (kept or Path(made)) / f"{control}-{len(done)}"
                make = partial(Rig, control=control, seed=chance.randrange(2**32))
                with staged(folder, number, "robot", make) as rig:
                    for cycle in _attacks(rig, chance, ends_at):
                        done.append(cycle)
                        if cycle.failures:
                            np.save(folder / f"trace-{len(done)}", list(rig.arm.trace))
                        log(
                            f"{control}, {cycle.fault}: " + "; ".join([cycle.note, *cycle.failures])
                        )
                    worst.add(rig.worst)
    failed = [cycle for cycle in done if cycle.failures]
    log(f"seed {seed}: {len(done)} faults, {len(failed)} failed; at worst {worst}")
    return not failed


def _attacks(rig: Rig, chance: random.Random, ends_at: float) -> Iterator[Cycle]:
    """Random faults, as long as robot_node recovers from them."""
    relayed = rig.control != "joint_trajectory"
    faults = [fault for fault in robot_faults() if relayed or not fault.rests]
    while time.monotonic() < ends_at:
        rig.wait(chance.uniform(0.0, PAUSE_S))
        hold_s = chance.uniform(0.1, LONGEST_S)
        fault = replace(chance.choice(faults), hold_s=hold_s, silent="may be short")
        cycle = run_cycle(rig, replace(fault, name=f"{fault.name}, {hold_s:.1f} s"))
        yield cycle
        if cycle.recovered_after is None:
            return
