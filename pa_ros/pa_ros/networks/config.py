"""Which networks an agent uses, as one frozen and checked description."""

from __future__ import annotations

from functools import cached_property
from math import floor
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32
from pa_ros.core.settings import OneOf, Settings, canonical_json, read_json
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.networks.families import FAMILIES, Programmable
from pa_ros.world.world import World


class NetworkSettings(Settings):
    """Actor and critic of one agent in any world (paper, appendix "Training parameters").

    `family`:
    - "programmable": both learn their detectors.
    - "distilled-critic": the actor learns detectors, the critic is given the true Φ (paper,
      "Zero-shot tasks").
    - "true-properties": both are given the true Φ; an upper reference, not in the paper.
    - "canonical": MLPs on the flattened Ω; see `pa_ros.networks.canonical`.
    - or one that an extension registers.

    With `relations_see_properties` false, f, r and the neighbourhood attention do not see an
    object's properties: these weights are zero and stay zero. What an object is then reaches the
    action only through p, so f and r cannot learn the looks of training objects. The paper gives f
    and r the whole of ω.

    `self_weight` multiplies exp α̃_ii, the attention that an object pays to itself: 1 is the paper's
    formula as it stands, at 0 the sums over j and k in eq. message-passing and α leave out i. The
    hand's relevance is 1 and a block's at first far less. So with 1 hardly anything of the blocks
    reaches h. With 0 only the ratios of p matter, and detectors may drift to words that no program
    uses.

    The paper does not give the initial weights of the programmable networks: all layers are uniform
    in ±1/√fan-in (torch's default for Linear) but for what the settings of initial weights say.
    With `detector_init_scale` 0, the usual start of a logistic regression, every object has all
    properties of a group equally, wherever it is.
    """

    SECTION: ClassVar[str] = "network"

    family: Annotated[str, OneOf(lambda: FAMILIES)] = Field(
        "programmable", description="kind of actor and critic"
    )
    hidden: int = Field(150, ge=1, le=4096, description="units of each layer (paper)")
    attention: int = Field(64, ge=1, le=4096, description="units of query and context (paper)")
    upper_layers: int = Field(
        0, ge=0, le=4, description="hidden layers after h, in actor and critic (paper: none)"
    )
    canonical_hidden: int = Field(
        400, ge=1, le=4096, description="units of the canonical MLPs (paper)"
    )
    position_scale: float = Field(5.0, gt=0, description="network units per metre")
    actor_output_scale: float = Field(
        3e-3, gt=0, description="initial weights: the actor's last layer is uniform in ± this"
    )
    critic_starts_unrewarded: bool = Field(
        False,
        description="initial weights: whether the critic's output starts at the value of never "
        "being rewarded, −1/(1−γ), instead of 0",
    )
    detector_init_scale: float = Field(
        1.0, ge=0, description="factor of the detectors' initial weights"
    )
    detectors_have_biases: bool = Field(
        True, description="whether detectors learn biases; without, each stays 0"
    )
    detectors_see_arm: bool = Field(
        True,
        description="whether detectors see the arm's features, which all objects share (paper)",
    )
    relations_see_properties: bool = Field(
        True, description="whether f, r and the attention see the properties (paper)"
    )
    self_weight: float = Field(
        1.0, ge=0, description="factor of an object's attention to itself (paper: 1)"
    )

    def for_world(self, world: World) -> NetworkConfig:
        """The same networks for one world, which fixes their inputs and outputs."""
        return NetworkConfig(world=world, **self.fields())

    def critic_start(self, discount: float) -> float:
        """The initial bias of the critic's output, where γ is `discount`.

        −1/(1−γ) is rounded toward zero to a whole number: −33 at γ = 0.97. All published agents
        were trained so, and the same seed must give the same weights to the bit.
        """
        if not self.critic_starts_unrewarded:
            return 0.0
        steps = 1.0 / (1.0 - discount)
        return -float(floor(steps + 1e-6))  # 1 / (1 − 0.99) is 99.999…


class NetworkConfig(NetworkSettings):
    """Actor and critic of one agent in one world: all that their tensors depend on."""

    world: World

    @model_validator(mode="after")
    def _learns_what_is_seen(self) -> Self:
        if FAMILIES[self.family].is_told_words and not self.world.schema.tells_words:
            raise ValueError(
                "family: expected one that learns what words mean, such as 'programmable', where "
                f"properties are seen and not told, got {self.family!r}"
            )
        return self

    @property
    def vocabulary(self) -> Vocabulary:
        """The world's words."""
        return self.world.vocabulary

    @property
    def input_scales(self) -> Float32:
        """Network units per unit of each feature of an object, [F]."""
        scales = self.world.schema.scales
        scales[:3] = self.position_scale
        return scales

    @property
    def actor(self) -> str:
        """Name of the family of the actor: families whose actors are the same share weights."""
        return FAMILIES[self.family].actor or self.family

    @cached_property
    def architecture(self) -> str:
        """Canonical JSON of what an actor's tensors mean: equal text, exchangeable weights."""
        family = FAMILIES[self.family]
        sizes = {name: getattr(self, setting) for name, setting in family.sizes.items()}
        if isinstance(family, Programmable):
            if self.self_weight != 1.0:  # absent where it is the paper's
                sizes["self_weight"] = float(self.self_weight)
            if self.upper_layers:  # likewise
                sizes["upper_layers"] = self.upper_layers
        given = {"position_scale": float(self.position_scale), "world": self.world.to_data()}
        return canonical_json({**sizes, "actor": self.actor, **given})

    def to_json(self) -> str:
        """Canonical JSON of every setting, the world among them."""
        values = self.model_dump(mode="json", exclude={"world"})
        return canonical_json({**values, "world": self.world.to_data()})

    @classmethod
    def from_json(cls, text: str) -> NetworkConfig:
        """The inverse of `to_json`; ConfigError for any other text."""
        try:
            values = dict(read_json(text))
            if "critic_output_bias" in values:  # older descriptions have its value
                values["critic_starts_unrewarded"] = values.pop("critic_output_bias") != 0
            return cls(world=World.from_data(values.pop("world")), **values)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise ConfigError(f"network description: {error}: got {text[:200]!r}") from error


def actor_config(architecture: str) -> NetworkConfig:
    """The configuration of an actor whose `architecture` text came with its weights.

    What the text does not hold (initial weights, the critic) keeps its default.
    Raises ConfigError if this version builds no such actor.
    """
    try:
        values = dict(read_json(architecture))
        settings = FAMILIES[values["actor"]].sizes
        sizes = {settings.get(k, k): v for k, v in values.items() if k not in ("actor", "world")}
        config = NetworkConfig(
            world=World.from_data(values["world"]), family=values["actor"], **sizes
        )
        text = canonical_json(values)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ConfigError(f"architecture: {error}: got {architecture[:200]!r}") from error
    if config.architecture != text:
        raise ConfigError(f"architecture: expected {config.architecture}, got {text[:500]}")
    return config
