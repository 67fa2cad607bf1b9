"""Every choice of the learning algorithm, with the paper's value or why it is ours."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Any

from pa_ros.core.errors import ConfigError

RELABEL = ("none", "all-goals")
ENGINES = ("auto", "fused", "torch")
DTYPES = ("float32", "float64")
NOISE_SCALES = ("stationary", "diffusion")


@dataclass(frozen=True)
class LearnerConfig:
    """Deterministic policy gradient (paper, appendix "Training parameters").

    Given by the paper: `batch_size`, `discount`, `replay_frames`, one update per action, the clip
    of ∂Q/∂a, hard target copies after each episode, `noise_sigma` and `noise_damping`. Everything
    else is not stated there and is a choice of ours.
    """

    batch_size: int = 64
    discount: float = 0.99
    first_discount: float = 0.9  # γ, instead, until …
    discount_rises_after: int = 0  # … so many updates; then 1/(1−γ) grows as t, up to `discount`
    replay_frames: int = 1_000_000  # observations kept
    updates_per_frame: float = 1.0
    action_gradient_clip: float = 1.0  # per element of ∂Q/∂a
    action_l2: float = 0.0  # of ½|a|², taken from Q in the actor's objective; keeps tanh alive
    action_l2_decay: float = 0.0  # the fraction of it that is lost, evenly, …
    action_l2_decay_updates: int = 20_000  # … within so many updates
    actor_rate: float = 1e-4  # not stated; Adam's, as in Lillicrap et al.
    critic_rate: float = 3e-4  # not stated; 1e-3 lets the critic forget the action
    rates_fall_after: int = 0  # updates, from where on both rates fall as 1/t; 0: they never do
    detector_gain: float = 1.0  # of both rates, for the detectors' weights
    detector_decay: float = 0.0  # of their weights per unit of rate, as AdamW's, falling to 0 …
    detector_decay_updates: int = 20_000  # … after so many updates
    geometry_decay: float = 0.0  # share of the detectors' weights of all but the one-hots that …
    geometry_decay_after: int = 30_000  # … each update takes away, once so many were made
    adam_beta1: float = 0.9
    adam_beta2: float = 0.999
    adam_epsilon: float = 1e-8
    warmup_frames: int = 1000  # frames before the first update
    reward_shift: float = 0.0  # added to every reward that the learner uses …
    reward_scale: float = 1.0  # … which is then multiplied by this; 1−γ bounds Q by 1
    relabel: str = "none"  # the paper's; "all-goals": see pa_ros.learning.relabeling.all_goals
    programs_per_transition: int = 1  # K; more than one needs relabeling
    relabel_keeps_original: bool = False  # the program that acted is always one of the K
    property_dropout: float = 0.0  # of transitions where a block's properties are hidden …
    property_dropout_after: int = 30_000  # … once so many updates were made
    trajectory_steps: int = 100  # transitions per trajectory: an episode
    policy_lag: int = 1  # trajectories; 0 is the paper's interleaving
    noise_sigma: float = 0.3
    noise_damping: float = 1.0  # per second
    noise_dt: float = 0.1  # seconds per control step
    noise_scale: str = "stationary"  # what sigma is the standard deviation of
    engine: str = "auto"  # "auto": the fused CPU update where it applies, else torch
    device: str = "cpu"
    dtype: str = "float32"
    threads: int = 1  # of the engine

    def __post_init__(self) -> None:
        _check_choices(self)
        _check_integers(self)
        _check_numbers(self)
        if self.programs_per_transition > 1 and self.relabel == "none":
            raise ConfigError(
                "learner programs_per_transition: expected 1 without relabeling, "
                f"got {self.programs_per_transition}"
            )
        if self.relabel_keeps_original and self.programs_per_transition == 1:
            raise ConfigError(
                "learner relabel_keeps_original: expected programs_per_transition of at least 2 "
                "with it, got 1, which would relabel nothing"
            )

    def to_json(self) -> str:
        """Canonical JSON of every field."""
        return json.dumps(asdict(self), sort_keys=True, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> LearnerConfig:
        """The inverse of `to_json`; ConfigError when the text is not such a configuration."""
        try:
            return cls(**json.loads(text))
        except (ValueError, TypeError) as error:
            raise ConfigError(f"learner configuration: {error}: got {text[:200]!r}") from error


def _refuse(name: str, expected: str, received: Any) -> None:
    raise ConfigError(f"learner {name}: expected {expected}, got {received!r}")


def _check_choices(config: LearnerConfig) -> None:
    choices = {
        "relabel": RELABEL,
        "engine": ENGINES,
        "dtype": DTYPES,
        "noise_scale": NOISE_SCALES,
    }
    for name, allowed in choices.items():
        if getattr(config, name) not in allowed:
            _refuse(name, f"one of {allowed}", getattr(config, name))


def _check_integers(config: LearnerConfig) -> None:
    least = {
        "batch_size": 1,
        "action_l2_decay_updates": 1,
        "detector_decay_updates": 1,
        "replay_frames": 2,
        "warmup_frames": 0,
        "programs_per_transition": 1,
        "geometry_decay_after": 0,
        "rates_fall_after": 0,
        "discount_rises_after": 0,
        "property_dropout_after": 0,
        "trajectory_steps": 1,
        "policy_lag": 0,
        "threads": 1,
    }
    for name, minimum in least.items():
        value = getattr(config, name)
        if not isinstance(value, int) or isinstance(value, bool) or value < minimum:
            _refuse(name, f"an integer of at least {minimum}", value)
    if config.trajectory_steps >= config.replay_frames:
        _refuse("replay_frames", f"more than trajectory_steps = {config.trajectory_steps}",
                config.replay_frames)  # fmt: skip


def _check_numbers(config: LearnerConfig) -> None:
    positive = (
        *("action_gradient_clip", "actor_rate", "critic_rate", "adam_epsilon"),
        *("detector_gain", "noise_dt", "reward_scale"),
    )
    others = (
        *("action_l2", "action_l2_decay", "detector_decay", "updates_per_frame"),
        *("noise_sigma", "noise_damping", "geometry_decay", "property_dropout", "reward_shift"),
    )
    for name in (*positive, *others):
        value = getattr(config, name)
        if not (isinstance(value, (int, float)) and math.isfinite(value)):
            _refuse(name, "a finite number", value)
        if (name in positive and value <= 0) or (name != "reward_shift" and value < 0):
            _refuse(name, "a positive number" if name in positive else "at least 0", value)
    for name in ("action_l2_decay", "geometry_decay", "property_dropout"):
        if getattr(config, name) > 1:
            _refuse(name, "a number in [0, 1]", getattr(config, name))
    for name in ("discount", "first_discount", "adam_beta1", "adam_beta2"):
        if not 0 <= getattr(config, name) < 1:
            _refuse(name, "a number in [0, 1)", getattr(config, name))
