"""Protocols: named sets of values over the defaults of learner and network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import OneOf, Settings, read_json
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
        "ours", description="how to learn: as the paper, or ours"
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
            return path, read_json(text)
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

# One recipe for every arm (RESULTS.md, "The recipe"): nothing in it depends on the arm or on how
# far learning is. Each transition is learned from under a training program drawn anew, whichever
# acted; now and then a block hides its properties; a horizon of two seconds and a critic that
# starts at the value of never being rewarded, −1/(1−γ); half the rates of Lillicrap et al.'s actor
# and of `paper`'s critic; about three times the paper's exploration noise; a hand that attends to
# itself about as little as to a block of undecided properties; f, r and the attention that see
# properties only through p. A word is few features, and none by default: what no evidence holds up
# of a detector's weights goes to zero, so that they can learn faster, and learning waits for the
# first frames, since the few blocks that were met until then bear many meanings of a word.
_OURS: Values = {
    "learner.relabeling.rule": "all-goals",
    "learner.relabeling.property_dropout": 0.3,
    "learner.replay.warmup_frames": 5000,
    "learner.optimizer.actor_rate": 5e-5,
    "learner.optimizer.critic_rate": 1.5e-4,
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

_BY_NAME = {"paper": _PAPER, "ours": _OURS}
PROTOCOLS = {name: Protocol(name, values) for name, values in _BY_NAME.items()}


def protocol_named(name: str, algorithm: str = "dpg") -> Protocol:
    """Look up a protocol, for an algorithm; ConfigError names the known ones of either."""
    if name not in PROTOCOLS:
        raise ConfigError(f"learner: expected a protocol of {sorted(PROTOCOLS)}, got {name!r}")
    values = ALGORITHMS[algorithm].values.get(name, {})
    return Protocol(name, {**PROTOCOLS[name].values, **values}, algorithm)
