"""What an arena says of itself to whoever comes."""

from __future__ import annotations

import numpy as np

from pa_ros.arena import Design, condition_named
from pa_ros.arena.conditions import program_text
from pa_ros.language import parse
from pa_ros.provenance import origins
from pa_ros.provenance.origins import JOINT_NAMES
from pa_ros.wire.records import ArenaDescription, Mode, Origin
from sim_node.session import Session

__all__ = ["JOINT_NAMES", "describe", "origin", "training_programs"]


def training_programs(design: Design) -> tuple[str, ...]:
    """Canonical texts of the programs that training episodes draw from, target by target."""
    condition, unused = condition_named("train", design), np.random.default_rng(0)
    texts = (program_text(condition, design, kind, unused)[0] for kind in design.train)
    return tuple(str(parse(text, design.vocabulary)) for text in texts)


def describe(session: Session) -> ArenaDescription:
    """The arena's latched description."""
    design, config = session.task.design, session.config
    mode = Mode.LOCKSTEP if config.mode == "lockstep" else Mode.REAL_TIME
    programs = training_programs(design)
    return origins.describe(session.arena, design, config.seed, programs, session.arena_id, mode)


def origin(session: Session, node: str) -> Origin:
    """The arena's account of itself, for recordings."""
    design, vocabulary = session.task.design, session.task.design.vocabulary
    return origins.origin(
        node,
        session.arena_id,
        session.config.seed,
        parameters=session.config.flat(),
        design=design.name,
        preset=session.arena.preset,
        shapes=vocabulary.shapes,
        colors=vocabulary.colors,
        vocabulary_digest=vocabulary.digest,
    )
