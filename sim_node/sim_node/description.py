"""What an arena says of itself to whoever comes."""

from __future__ import annotations

from dataclasses import replace

from pa_ros.arena import generate, training_programs
from pa_ros.provenance import origins
from pa_ros.wire.arena import ArenaDescription, Mode
from pa_ros.wire.diagnostics import Origin
from sim_node.session import Session

__all__ = ["describe", "origin"]


def describe(session: Session) -> ArenaDescription:
    """The arena's latched description."""
    design, config = session.task.design, session.config
    mode = Mode.LOCKSTEP if config.mode == "lockstep" else Mode.REAL_TIME
    programs = training_programs(design)
    known = session.arena, design, config.seed, programs, session.arena_id, mode
    about = origins.describe(*known, session.task.scoring.reward)
    condition = config.condition_of(config.condition)  # which may have more blocks, or fewer
    scene = generate(session.arena, design, condition, config.seed, config.first_episode)
    return replace(about, block_count=len(scene.blocks))


def origin(session: Session, node: str) -> Origin:
    """The arena's account of itself, for recordings."""
    return origins.origin(
        node,
        session.arena_id,
        session.config.seed,
        parameters=session.config.flat(),
        design=session.task.design.name,
        arm=session.arena.arm,
        preset=session.arena.preset,
        world=session.task.world,
    )
