"""Provenance: which software and settings made a run, and a description of its arena."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from pa_ros.arena import ARMS, ArenaConfig, Design, scoring_of, world_of
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.core import __version__
from pa_ros.core.clock import now_ns
from pa_ros.core.software import here
from pa_ros.language import Program
from pa_ros.wire.arena import ArenaDescription, Mode
from pa_ros.wire.diagnostics import LearnerOrigin, Origin
from pa_ros.world import Reward, Sparse

if TYPE_CHECKING:  # it imports torch, which an arena does not need
    from pa_ros.learning.learner import Learner


def origin(node: str, instance: str, seed: int, **of_process: Any) -> Origin:
    """The provenance of this process; `of_process` are other fields of Origin."""
    return Origin(
        node=node,
        instance=instance,
        seed=seed,
        software_version=__version__,
        versions=here(),
        stamp_ns=now_ns(),
        **{"parameters": {}, **of_process},
    )


def learner_origin(
    node: str,
    instance: str,
    seed: int,
    learner: Learner,
    training_programs: Iterable[Program],
    **of_process: Any,
) -> Origin:
    """The provenance of a learner, with its settings and training programs."""
    parameters = {"engine": learner.engine.name, **of_process.pop("parameters", {})}
    return origin(
        node,
        instance,
        seed,
        world=learner.network.world,
        parameters=parameters,
        learner=LearnerOrigin(
            first_version=learner.counters.version,
            network=learner.network.to_json(),
            learner=learner.config.to_json(),
            algorithm=learner.config.ALGORITHM,
            training_programs=tuple(training_programs),
        ),
        **of_process,
    )


def describe(
    arena: ArenaConfig,
    design: Design,
    seed: int,
    training_programs: Iterable[Program],
    instance: str,
    mode: Mode = Mode.LOCKSTEP,
    reward: Reward | None = None,
) -> ArenaDescription:
    """The description that an arena publishes; the default `reward` is the paper's."""
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
