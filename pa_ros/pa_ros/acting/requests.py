"""What a learner asks of an agent, and whether the agent can do so."""

from __future__ import annotations

from typing import NamedTuple

from pa_ros.acting.config import ExplorationConfig
from pa_ros.acting.errors import ActingError
from pa_ros.core.errors import ConfigError
from pa_ros.core.published import LearnerInfo
from pa_ros.networks.config import NetworkConfig, actor_config

INFERENCES = ("auto", "torch")


class ArenaFacts(NamedTuple):
    """What an arena says of itself that its learners must know, too: fields of LearnerInfo."""

    world_digest: str
    control_period: float  # s
    thresholds: tuple[float, ...]  # of the world's relations
    reward: str  # canonical JSON: name and parameters


def check_arena(learner: LearnerInfo, arena: ArenaFacts) -> None:
    """Raise ActingError unless the learner is one for the agent's arena.

    By which algorithm it learns doesn't matter here: how to act follows from the architecture, the
    exploration and the inference that it asks for.
    """
    for name in arena._fields:
        _check_fact(learner, arena, name)
    if learner.inference not in INFERENCES:
        raise ActingError(
            f"learner_info.inference: expected one of {INFERENCES}, got {learner.inference!r}",
            code="learner.request",
        )


def check_words(learner: LearnerInfo, arena: ArenaFacts) -> None:
    """Raise ActingError unless the learner's words are the arena's: what a greedy agent
    needs of it."""
    _check_fact(learner, arena, "world_digest")


def _check_fact(learner: LearnerInfo, arena: ArenaFacts, name: str) -> None:
    expected, received = getattr(arena, name), getattr(learner, name)
    if received != expected:
        raise ActingError(
            f"learner_info.{name}: expected {expected!r}, as this arena's, got {received!r}",
            code="learner.request",
        )


def network_of(learner: LearnerInfo) -> NetworkConfig:
    """The actor's network. ActingError if it cannot be built here."""
    try:
        network = actor_config(learner.architecture)
    except ConfigError as error:
        raise ActingError(f"learner_info.architecture: {error}", code="learner.request") from error
    if network.world.digest != learner.world_digest:
        raise ActingError(
            f"learner_info.architecture: expected the world {learner.world_digest}, "
            f"got {network.world.digest}",
            code="learner.request",
        )
    return network


def exploration_of(learner: LearnerInfo) -> ExplorationConfig:
    """The exploration noise. ActingError if it is not known here."""
    try:
        return ExplorationConfig.from_json(learner.exploration)
    except ConfigError as error:
        raise ActingError(f"learner_info.exploration: {error}", code="learner.request") from error
