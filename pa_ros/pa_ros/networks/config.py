"""Which networks an agent uses, as one frozen and checked description."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import ARM_FEATURES, JOINTS, OBJECT_FEATURES
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.networks.families import FAMILIES, Family, family_named

KINDS = tuple(FAMILIES)


@dataclass(frozen=True)
class NetworkConfig:
    """Actor and critic of one agent (paper, appendix "Training parameters").

    `kind`:
    - "programmable": both learn their detectors.
    - "distilled-critic": the actor learns detectors, the critic is given the true Φ (paper,
      "Zero-shot tasks").
    - "true-properties": both are given the true Φ; an upper reference, not in the paper.
    - "canonical": MLPs on the flattened Ω; see `pa_ros.networks.canonical`.

    With `relations_see_properties` false, f, r and the neighbourhood attention have zero weights
    for the one-hots of shape and color, and keep them: what an object is reaches the action only
    through p, so nothing else can come to rely on the properties seen in training. The paper gives
    f and r the whole of ω.

    `self_weight` multiplies exp α̃_ii, the attention that an object pays to itself: 1 is the paper's
    formula as it stands, at 0 the sums over j and k in eq. message-passing and α leave out i. The
    hand's relevance is 1 and a block's at first far less, so that with 1 hardly anything of the
    blocks reaches h; with 0 only the ratios of p count, and nothing keeps the detectors' degrees
    from drifting into words that no program uses.

    The other options from `actor_output_scale` on concern only the initial weights, which the
    paper does not give for the programmable networks: all layers are uniform in ±1/√fan-in
    (torch's default for Linear), the actor's last layer is uniform in ±`actor_output_scale`, and
    the critic's output bias starts at `critic_output_bias`; −1/(1−γ) = −100 starts it at the value
    of never being rewarded.
    `detector_init_scale` multiplies the detectors' initial weights: at 0, the usual start of a
    logistic regression, every object has all properties of a group equally, wherever it is.
    """

    vocabulary: Vocabulary
    kind: str = "programmable"
    hidden: int = 150
    attention: int = 64
    canonical_hidden: int = 400
    position_scale: float = 5.0  # network units per metre
    actor_output_scale: float = 3e-3
    critic_output_bias: float = 0.0
    detector_init_scale: float = 1.0
    relations_see_properties: bool = True
    self_weight: float = 1.0

    def __post_init__(self) -> None:
        family_named(self.kind)
        for name in ("hidden", "attention", "canonical_hidden"):
            size = getattr(self, name)
            if not isinstance(size, int) or size < 1:
                raise ConfigError(f"network {name}: expected a positive integer, got {size!r}")
        for name in ("position_scale", "actor_output_scale"):
            scale = getattr(self, name)
            if not (math.isfinite(scale) and scale > 0):
                raise ConfigError(f"network {name}: expected a positive number, got {scale!r}")
        for name in ("detector_init_scale", "self_weight"):
            scale = getattr(self, name)
            if not (math.isfinite(scale) and scale >= 0):
                raise ConfigError(f"network {name}: expected at least 0, got {scale!r}")
        if not math.isfinite(self.critic_output_bias):
            raise ConfigError(
                f"network critic_output_bias: expected a number, got {self.critic_output_bias!r}"
            )

    @property
    def family(self) -> Family:
        """What depends on the kind."""
        return family_named(self.kind)

    @cached_property
    def architecture(self) -> str:
        """Canonical JSON of what an actor's tensors mean: equal text, exchangeable weights."""
        return _canonical_json(
            {
                **self.family.sizes(self),
                "actor": self.family.actor,
                "shapes": list(self.vocabulary.shapes),
                "colors": list(self.vocabulary.colors),
                "position_scale": float(self.position_scale),
                "object_features": OBJECT_FEATURES,
                "arm_features": ARM_FEATURES,
                "actions": JOINTS,
            }
        )

    def to_json(self) -> str:
        """Canonical JSON of every field."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "vocabulary"}
        words = {"shapes": self.vocabulary.shapes, "colors": self.vocabulary.colors}
        return _canonical_json({**values, **words})

    @classmethod
    def from_json(cls, text: str) -> NetworkConfig:
        """The inverse of `to_json`; ConfigError when the text is not such a description."""
        try:
            values = json.loads(text)
            vocabulary = Vocabulary(tuple(values.pop("shapes")), tuple(values.pop("colors")))
            return cls(vocabulary=vocabulary, **values)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise ConfigError(f"network description: {error}: got {text[:200]!r}") from error


def actor_config(architecture: str) -> NetworkConfig:
    """The configuration of an actor whose `architecture` text came with its weights.

    What the text does not hold (initial weights, the critic) keeps its default.
    Raises ConfigError if this version builds no such actor.
    """
    try:
        values = json.loads(architecture)
        config = NetworkConfig(
            vocabulary=Vocabulary(tuple(values["shapes"]), tuple(values["colors"])),
            kind=values["actor"],
            position_scale=values["position_scale"],
            **family_named(values["actor"]).fields(values),
        )
    except (ValueError, TypeError, KeyError) as error:
        raise ConfigError(f"architecture: {error}: got {architecture[:200]!r}") from error
    if config.architecture != architecture:
        raise ConfigError(f"architecture: expected {config.architecture}, got {architecture[:500]}")
    return config


def _canonical_json(values: dict[str, Any]) -> str:
    return json.dumps(values, sort_keys=True, separators=(",", ":"))
