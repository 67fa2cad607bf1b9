"""Protocols: named sets of values over the defaults of learner and network."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import OneOf, Settings
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import FAMILIES
from pa_ros.world.schema import PAPER
from pa_ros.world.world import World

Values = Mapping[str, Any]  # by dotted path, "learner.PART.NAME" or "network.NAME"


class LearningChoice(Settings):
    """How to learn and with which networks, by name."""

    protocol: Annotated[str, OneOf(lambda: PROTOCOLS)] = Field(
        "ours", description="how to learn; ours-slow is for the preset paper, small for both arms"
    )
    algorithm: Annotated[str, OneOf(lambda: ALGORITHMS)] = Field(
        "dpg", description="by which to learn"
    )
    network: Annotated[str, OneOf(lambda: FAMILIES)] = Field(
        "programmable", description="family of actor and critic"
    )


@dataclass(frozen=True)
class Protocol:
    """How to learn: the values that differ from the defaults, and by which algorithm."""

    name: str
    values: Values = field(default_factory=dict)
    algorithm: str = "dpg"

    @cached_property
    def learner(self) -> LearnerConfig:
        """The learner's settings; ConfigError for a value that they refuse."""
        return ALGORITHMS[self.algorithm].config().changed(**self.of("learner"))

    def network_config(self, world: World, kind: str = "programmable") -> NetworkConfig:
        """The network's settings for a world; ConfigError likewise."""
        default = NetworkConfig(world=world, kind=kind)  # type: ignore[arg-type]
        return default.changed(**self.of("network"))

    def of(self, room: str) -> dict[str, Any]:
        """The values of "learner" or "network", by their paths inside it."""
        return {
            path.partition(".")[2]: value
            for path, value in self.values.items()
            if path.partition(".")[0] == room
        }

    def with_options(self, options: Iterable[str]) -> Protocol:
        """Replace values given as `learner.PART.NAME=VALUE` or `network.NAME=VALUE`.

        Values are JSON where they parse as such, else text. Raises ConfigError for an unknown
        path or a value that is refused.
        """
        given = dict(map(self._split, options))
        changed = Protocol(self.name, {**self.values, **given}, self.algorithm)
        changed.network_config(World(PAPER, PAPER.vocabulary, joints=6))
        _ = changed.learner
        return changed

    @staticmethod
    def _split(option: str) -> tuple[str, Any]:
        path, equals, text = option.partition("=")
        room, dot, _ = path.partition(".")
        if not equals or not dot or room not in ("learner", "network"):
            raise ConfigError(
                "option: expected learner.PART.NAME=VALUE or network.NAME=VALUE with a known name, "
                f"got {option!r}"
            )
        try:
            return path, json.loads(text)
        except ValueError:
            return path, text


# As in the appendix; of what it leaves open, the initial weights matter most: a critic that
# starts at the value of never being rewarded, −1/(1−γ), and detectors that start undecided.
_PAPER: Values = {
    "learner.schedule.trajectory_steps": 1,
    "learner.schedule.policy_lag": 0,
    "network.critic_output_bias": -100.0,
    "network.detector_init_scale": 0.0,
}

# What makes learning fast and reliable: each transition is learned from under two training
# programs, whichever acted; a hand that attends to itself about as little as to a block of
# undecided properties; a horizon of a second, so that what the critic makes up early does not
# drown the reward; rewards scaled so that Q is of order one, and a critic that starts at the
# value of never being rewarded; detectors that start undecided, learn faster than the rest and
# at first forget what is not confirmed; an actor that pays for large actions, so that the
# critic's first errors don't saturate it; f, r and the attention that see properties only
# through p; and about three times the paper's exploration noise. Once words are grounded, the
# detectors are made to forget where things are, and now and then a block hides its properties.
_OURS: Values = {
    "learner.relabeling.rule": "all-goals",
    "learner.relabeling.programs_per_transition": 2,
    "learner.relabeling.property_dropout": 0.3,
    "learner.updates.discount": 0.9,
    "learner.updates.reward_scale": 0.5,
    "learner.actor.action_l2": 0.01,
    "learner.detectors.gain": 3.0,
    "learner.detectors.decay": 0.5,
    "learner.detectors.geometry_decay": 0.001,
    "learner.exploration.sigma": 1.0,
    "network.critic_output_bias": -5.0,
    "network.detector_init_scale": 0.0,
    "network.position_scale": 10.0,
    "network.relations_see_properties": False,
    "network.self_weight": 0.03,
}

# For an arm that needs up to 50 steps to a block, not 17: where it is far, Q rises by so little
# for a step that ours' price of moving exceeds it, and the arm learns to stay. Twice the horizon in
# the end, with the same bound of Q, and a price that falls to a tenth once the critic knows
# something; ours' horizon until words are grounded, and detectors that forget for as long, which is
# later than on the fast arm. Far starts are few among what is learned from later, so the rates fall
# before they are unlearned.
_OURS_SLOW: Values = {
    **_OURS,
    "learner.updates.discount": 0.95,
    "learner.updates.discount_rises_after": 40_000,
    "learner.updates.reward_scale": 0.25,
    "learner.actor.action_l2_decay": 0.9,
    "learner.detectors.decay_updates": 60_000,
    "learner.detectors.geometry_decay_after": 50_000,
    "learner.relabeling.property_dropout_after": 80_000,
    "learner.optimizer.rates_fall_after": 80_000,
}

# One recipe for both arms (RESULTS.md, "The small recipe"): nothing in it depends on the arm or on
# how far learning is. A word is few features, and none by default: what no evidence holds up of a
# detector's weights goes to zero, so that they can learn faster, and learning waits for 5,000
# frames, since the few blocks that were met until then bear many meanings of a word. The critic
# starts at the value of never being rewarded, −1/(1−γ).
_SMALL: Values = {
    "learner.relabeling.rule": "all-goals",
    "learner.relabeling.property_dropout": 0.3,
    "learner.relabeling.property_dropout_after": 0,
    "learner.replay.warmup_frames": 5000,
    "learner.updates.discount": 0.95,
    "learner.detectors.gain": 3.0,
    "learner.detectors.sparsity": 0.3,
    "learner.exploration.sigma": 1.0,
    "network.critic_output_bias": -20.0,
    "network.detector_init_scale": 0.0,
    "network.detectors_have_biases": False,
    "network.position_scale": 20.0,
    "network.relations_see_properties": False,
    "network.self_weight": 0.03,
}

_BY_NAME = {"paper": _PAPER, "ours": _OURS, "ours-slow": _OURS_SLOW, "small": _SMALL}
PROTOCOLS = {name: Protocol(name, values) for name, values in _BY_NAME.items()}


def usual_protocol(preset: str) -> str:
    """Name of the protocol that learns with an arena preset's arm."""
    return "ours-slow" if preset == "paper" else "ours"


def protocol_named(name: str, algorithm: str = "dpg") -> Protocol:
    """Look up a protocol, for an algorithm; ConfigError names the known ones of either."""
    if name not in PROTOCOLS:
        raise ConfigError(f"learner: expected a protocol of {sorted(PROTOCOLS)}, got {name!r}")
    values = ALGORITHMS[algorithm].values.get(name, {})
    return Protocol(name, {**PROTOCOLS[name].values, **values}, algorithm)
