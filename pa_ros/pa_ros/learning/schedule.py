"""All that follows from the number of updates made: one pure function, for every engine."""

from __future__ import annotations

from pa_ros.core.update import UpdateValues
from pa_ros.learning.config import (
    ActorConfig,
    DetectorsConfig,
    LearnerConfig,
    OptimizerConfig,
    UpdatesConfig,
)


def values_after(updates: int, config: LearnerConfig) -> UpdateValues:
    """What the update that follows so many is made with."""
    optimizer, detectors, relabeling = config.optimizer, config.detectors, config.relabeling
    rate, discount = _rate_share(updates, optimizer), _discount(updates, config.updates)
    forgets = updates >= detectors.geometry_decay_after
    hides = updates >= relabeling.property_dropout_after
    return UpdateValues(
        actor_rate=optimizer.actor_rate * rate,
        critic_rate=optimizer.critic_rate * rate,
        correction1=1.0 - optimizer.beta1 ** (updates + 1),
        correction2=1.0 - optimizer.beta2 ** (updates + 1),
        action_l2=_action_l2(updates, config.actor),
        detector_decay=_detector_decay(updates, detectors),
        geometry_decay=detectors.geometry_decay if forgets else 0.0,
        discount=discount,
        reward_scale=config.updates.reward_scale
        * ((1.0 - discount) / (1.0 - config.updates.discount)),
        property_dropout=relabeling.property_dropout if hides else 0.0,
    )


def _rate_share(updates: int, config: OptimizerConfig) -> float:
    """Of both rates: 1, then falling as 1/t."""
    constant = config.rates_fall_after
    return constant / updates if 0 < constant < updates else 1.0


def _discount(updates: int, config: UpdatesConfig) -> float:
    """γ (François-Lavet et al. 2015: a horizon that grows): 1/(1−γ) stays, then rises as t."""
    constant = config.discount_rises_after
    if not constant:
        return config.discount
    growth = max(1.0, updates / constant)
    return min(config.discount, 1.0 - (1.0 - config.first_discount) / growth)


def _action_l2(updates: int, config: ActorConfig) -> float:
    """The weight of ½|a|²: falling evenly, then what is left of it."""
    spent = min(1.0, updates / config.action_l2_decay_updates)
    return config.action_l2 * (1.0 - config.action_l2_decay * spent)


def _detector_decay(updates: int, config: DetectorsConfig) -> float:
    """Falling evenly to nothing."""
    spent = min(1.0, updates / config.decay_updates)
    return config.decay * (1.0 - spent)
