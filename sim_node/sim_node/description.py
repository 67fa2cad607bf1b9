"""What an arena says of itself to whoever comes."""

from __future__ import annotations

import numpy as np

from pa_ros import __version__
from pa_ros.arena import Design, condition_named
from pa_ros.arena.conditions import program_text
from pa_ros.arena.features import HAND_INDEX
from pa_ros.core.experience import JOINTS
from pa_ros.language import parse
from pa_ros.wire.records import ArenaDescription, Mode
from sim_node.session import Session

JOINT_NAMES = tuple(f"joint_{i}" for i in range(1, JOINTS + 1))


def training_programs(design: Design) -> tuple[str, ...]:
    """Canonical texts of the programs that training episodes draw from, target by target."""
    condition, unused = condition_named("train", design), np.random.default_rng(0)
    texts = (program_text(condition, design, kind, unused)[0] for kind in design.train)
    return tuple(str(parse(text, design.vocabulary)) for text in texts)


def describe(session: Session) -> ArenaDescription:
    """The arena's latched description."""
    arena, design, config = session.arena, session.task.design, session.config
    return ArenaDescription(
        mode=Mode.LOCKSTEP if config.mode == "lockstep" else Mode.REAL_TIME,
        design=design.name,
        preset=arena.preset,
        seed=config.seed,
        block_count=design.n_blocks,
        shapes=design.vocabulary.shapes,
        colors=design.vocabulary.colors,
        vocabulary_digest=design.vocabulary.digest,
        training_programs=training_programs(design),
        joint_names=JOINT_NAMES,
        joint_lower=arena.joint_lower,
        joint_upper=arena.joint_upper,
        speed_limits=arena.joint_speed_limits,
        control_period=arena.control_period_s,
        near_threshold=arena.near_threshold_m,
        episode_steps=arena.episode_steps,
        hand_index=HAND_INDEX,
        arena_id=session.arena_id,
        software_version=__version__,
    )
