"""Named settings of learner and network: the paper's, and ours."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.learning.algorithms.dpg.config import LearnerConfig
from pa_ros.networks.config import NetworkConfig


@dataclass(frozen=True)
class Protocol:
    """How to learn: `network` holds the options of NetworkConfig that differ from its defaults."""

    name: str
    learner: LearnerConfig
    network: tuple[tuple[str, Any], ...] = ()

    def network_config(self, vocabulary: Vocabulary, kind: str = "programmable") -> NetworkConfig:
        """The network's configuration for a vocabulary."""
        return NetworkConfig(vocabulary, kind, **dict(self.network))

    def with_options(self, options: Iterable[str]) -> Protocol:
        """Replace options given as `learner.NAME=VALUE` or `network.NAME=VALUE`.

        Values are JSON where they parse as such, else text. Raises ConfigError for an unknown
        name or a value that the configuration refuses.
        """
        learner: dict[str, Any] = {}
        network = dict(self.network)
        for option in options:
            room, name, value = _split(option)
            {"learner": learner, "network": network}[room][name] = value
        return replace(
            self, learner=replace(self.learner, **learner), network=tuple(sorted(network.items()))
        )


_ROOMS = {"learner": LearnerConfig, "network": NetworkConfig}


def _split(option: str) -> tuple[str, str, Any]:
    path, equals, text = option.partition("=")
    room, _, name = path.partition(".")
    known = {f.name for f in fields(_ROOMS[room])} if room in _ROOMS else set()
    if not equals or name not in known:
        raise ConfigError(
            f"option: expected learner.NAME=VALUE or network.NAME=VALUE with a known name, "
            f"got {option!r}"
        )
    try:
        return room, name, json.loads(text)
    except ValueError:
        return room, name, text


# As in the appendix; of what it leaves open, the initial weights matter most: a critic that
# starts at the value of never being rewarded, −1/(1−γ), and detectors that start undecided.
_PAPER = Protocol(
    "paper",
    LearnerConfig(trajectory_steps=1, policy_lag=0),
    (("critic_output_bias", -100.0), ("detector_init_scale", 0.0)),
)

# What makes learning fast and reliable: each transition is learned from under two training
# programs, whichever acted; a hand that attends to itself about as little as to a block of
# undecided properties; a horizon of a second, so that what the critic makes up early does not
# drown the reward; rewards scaled so that Q is of order one, and a critic that starts at the
# value of never being rewarded; detectors that start undecided, learn faster than the rest and
# at first forget what is not confirmed; an actor that pays for large actions, so that the
# critic's first errors don't saturate it; f, r and the attention that see properties only
# through p; and about three times the paper's exploration noise. Once words are grounded, the
# detectors are made to forget where things are, and now and then a block hides its properties.
_OURS = Protocol(
    "ours",
    LearnerConfig(
        relabel="all-goals",
        programs_per_transition=2,
        discount=0.9,
        reward_scale=0.5,
        action_l2=0.01,
        detector_gain=3.0,
        detector_decay=0.5,
        noise_sigma=1.0,
        geometry_decay=0.001,
        property_dropout=0.3,
    ),
    (
        ("critic_output_bias", -5.0),
        ("detector_init_scale", 0.0),
        ("position_scale", 10.0),
        ("relations_see_properties", False),
        ("self_weight", 0.03),
    ),
)

# For an arm that needs up to 50 steps to a block, not 17: where it is far, Q rises by so little
# for a step that ours' price of moving exceeds it, and the arm learns to stay. Twice the horizon in
# the end, with the same bound of Q, and a price that falls to a tenth once the critic knows
# something; ours' horizon until words are grounded, and detectors that forget for as long, which is
# later than on the fast arm. Far starts are few among what is learned from later, so the rates fall
# before they are unlearned.
_OURS_SLOW = replace(
    _OURS,
    name="ours-slow",
    learner=replace(
        _OURS.learner,
        discount=0.95,
        discount_rises_after=40_000,
        reward_scale=0.25,
        action_l2_decay=0.9,
        detector_decay_updates=60_000,
        rates_fall_after=80_000,
        geometry_decay_after=50_000,
        property_dropout_after=80_000,
    ),
)

PROTOCOLS = {protocol.name: protocol for protocol in (_PAPER, _OURS, _OURS_SLOW)}


def usual_protocol(preset: str) -> str:
    """Name of the protocol that learns with an arena preset's arm."""
    return "ours-slow" if preset == "paper" else "ours"


def protocol_named(name: str) -> Protocol:
    """Look up a protocol; ConfigError names the known ones."""
    if name not in PROTOCOLS:
        raise ConfigError(f"learner: expected a protocol of {sorted(PROTOCOLS)}, got {name!r}")
    return PROTOCOLS[name]
