"""Checkpoints of version 0.1: their settings are one flat list of names."""

from __future__ import annotations

from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import read_json
from pa_ros.language.syntax import NEAR
from pa_ros.learning.algorithms.dpg.config import DPGConfig
from pa_ros.world import Scoring

FORMAT = 1  # of the checkpoint
_FACTS = ("near_threshold", "noise_dt")  # come from the arena now
_NAMES = {  # there: here
    "batch_size": "replay.batch_size",
    "replay_frames": "replay.capacity_frames",
    "warmup_frames": "replay.warmup_frames",
    "updates_per_frame": "updates.per_frame",
    "discount": "updates.discount",
    "first_discount": "updates.first_discount",
    "discount_rises_after": "updates.discount_rises_after",
    "reward_shift": "updates.reward_shift",
    "reward_scale": "updates.reward_scale",
    "action_gradient_clip": "actor.gradient_clip",
    "action_l2": "actor.action_l2",
    "action_l2_decay": "actor.action_l2_decay",
    "action_l2_decay_updates": "actor.action_l2_decay_updates",
    "actor_rate": "optimizer.actor_rate",
    "critic_rate": "optimizer.critic_rate",
    "rates_fall_after": "optimizer.rates_fall_after",
    "adam_beta1": "optimizer.beta1",
    "adam_beta2": "optimizer.beta2",
    "adam_epsilon": "optimizer.epsilon",
    "detector_gain": "detectors.gain",
    "detector_decay": "detectors.decay",
    "detector_decay_updates": "detectors.decay_updates",
    "geometry_decay": "detectors.geometry_decay",
    "geometry_decay_after": "detectors.geometry_decay_after",
    "relabel": "relabeling.rule",
    "programs_per_transition": "relabeling.programs_per_transition",
    "relabel_keeps_original": "relabeling.keeps_original",
    "property_dropout": "relabeling.property_dropout",
    "property_dropout_after": "relabeling.property_dropout_after",
    "stretch_steps": "schedule.trajectory_steps",
    "policy_lag": "schedule.policy_lag",
    "noise_sigma": "exploration.sigma",
    "noise_damping": "exploration.damping",
    "noise_scale": "exploration.scale",
    "backend": "engine.name",
    "device": "engine.device",
    "dtype": "engine.dtype",
    "threads": "engine.threads",
}


def read(values: dict[str, Any]) -> dict[str, Any]:
    """A checkpoint's metadata as the next format has it; ConfigError if it is not 0.1's."""
    try:
        given = read_json(values["learner"])
        near_m = given["near_threshold"]
        settings = {_NAMES[name]: value for name, value in given.items() if name not in _FACTS}
    except (ValueError, AttributeError, TypeError, KeyError) as error:
        raise ConfigError(f"learner: expected the settings of version 0.1: {error!r}") from error
    learner = DPGConfig().changed(**settings).to_json()
    return values | {
        "format": FORMAT + 1,
        "learner": learner,
        "scoring": repr(Scoring({NEAR: near_m})),
    }
