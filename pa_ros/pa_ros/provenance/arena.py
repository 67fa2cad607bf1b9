"""The description that an arena publishes.

A file of its own: agents and learners import the package, but do not need the simulator.
"""

from __future__ import annotations

from collections.abc import Iterable

from pa_ros.arena import ARMS, ArenaConfig, Design, scoring_of, world_of
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.core import __version__
from pa_ros.language import Program
from pa_ros.wire.arena import ArenaDescription, Mode
from pa_ros.world import Reward, Sparse


def describe(
    arena: ArenaConfig,
    design: Design,
    seed: int,
    training_programs: Iterable[Program],
    instance: str,
    mode: Mode = Mode.LOCKSTEP,
    reward: Reward | None = None,
) -> ArenaDescription:
    """Describe an arena; the default `reward` is the paper's."""
    return ArenaDescription(
        mode=mode,
        design=design.name,
        arm=arena.arm,
        preset=arena.preset,
        seed=seed,
        block_count=design.n_blocks + design.n_places,
        world=world_of(arena, design),
        training_programs=tuple(training_programs),
        joint_names=ARMS[arena.arm].joint_names,
        joint_lower=arena.joint_lower,
        joint_upper=arena.joint_upper,
        speed_limits=arena.joint_speed_limits,
        control_period=arena.control_period_s,
        thresholds=tuple(scoring_of(arena, design).thresholds.values()),
        episode_steps=arena.episode_steps,
        reward=(reward or Sparse()).to_json(),
        hand_index=HAND_INDEX,
        arena_id=instance,
        software_version=__version__,
    )
