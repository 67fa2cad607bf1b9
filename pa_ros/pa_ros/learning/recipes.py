"""How to learn: all settings of learner and network, with named sets of defaults (recipes)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from pa_ros.core.settings import OneOf, Settings, nested
from pa_ros.language import Vocabulary
from pa_ros.language.syntax import ON
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.config import LearnerConfig
from pa_ros.networks.config import NetworkSettings

OURS, DPG = "ours", "dpg"  # the defaults
PUSH, STACK, DEEP, ENTRIES = "push", "stack", "deep", "entries"  # of some designs: see `recipe_for`
ZONE = "zone"  # a group of words, of small zones
Values = Mapping[str, Any]  # by dotted path, "learner.PART.NAME" or "network.NAME"

# As in the appendix. Of what it leaves open, the initial weights matter most: a critic that starts
# at the value of never being rewarded, −1/(1−γ), and detectors that start undecided.
_PAPER: Values = {
    "learner.schedule.trajectory_steps": 1,
    "learner.schedule.policy_lag": 0,
    "network.critic_starts_unrewarded": True,
    "network.detector_init_scale": 0.0,
}

# One recipe for every arm (docs/DESIGN.md, "What our recipe changes, and why"). Nothing in it
# depends on the arm or on how far learning is.
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
    "network.critic_starts_unrewarded": True,
    "network.detector_init_scale": 0.0,
    "network.detectors_have_biases": False,
    "network.position_scale": 20.0,
    "network.relations_see_properties": False,
    "network.self_weight": 0.03,
}

# For programs that move objects. What differs from ours: a layer more, larger steps of larger
# batches that become smaller, a longer horizon, and less noise that lasts less long.
_PUSH: Values = {
    **_OURS,
    "learner.replay.batch_size": 128,
    "learner.optimizer.actor_rate": 2e-4,
    "learner.optimizer.critic_rate": 6e-4,
    "learner.optimizer.half_life": 40_000,
    "learner.updates.discount": 0.97,
    "learner.exploration.sigma": 0.2,
    "learner.exploration.held": 0.3,
    "learner.detectors.sparsity": 0.1,
    "learner.relabeling.property_dropout": 0.0,
    "network.upper_layers": 1,
    "network.hidden": 128,
    "network.attention": 32,
}

# For programs that put objects on each other: smaller steps later, words of objects alone, and an
# agent that acts by a running mean of the actor, which places blocks more exactly than the newest.
_STACK: Values = {
    **_PUSH,
    "learner.optimizer.half_life": 80_000,
    "learner.updates.published": 0.2,
    "network.detectors_see_arm": False,
}

# For programs that say more than where the hand should be near: that avoid a set, or have one of
# several relations. A layer more, and larger steps of larger batches that become smaller.
_DEEP: Values = {
    **_OURS,
    "learner.replay.batch_size": 128,
    "learner.optimizer.actor_rate": 2e-4,
    "learner.optimizer.critic_rate": 6e-4,
    "learner.optimizer.half_life": 20_000,
    "network.upper_layers": 1,
    "network.hidden": 128,
    "network.attention": 32,
}

# For small zones: hindsight around entries, whose rewards end the task, so that values are in
# [0, 1].
_ENTRIES: Values = {
    **_DEEP,
    "learner.relabeling.rule": "entries",
    "learner.relabeling.property_dropout": 0.0,
    "learner.replay.warmup_frames": 10_000,
    "learner.replay.batch_size": 256,
    "learner.optimizer.actor_rate": 5e-4,
    "learner.optimizer.critic_rate": 1e-3,
    "learner.updates.per_frame": 0.3,
    "learner.updates.published": 0.2,
    "learner.detectors.gain": 2.0,
    "learner.detectors.sparsity": 0.0,
    "learner.exploration.sigma": 0.3,
    "learner.exploration.held": 0.6,
    "network.critic_starts_unrewarded": False,
    "network.upper_layers": 2,
    "network.hidden": 64,
    "network.attention": 16,
}

RECIPES: Mapping[str, Values] = {
    "paper": _PAPER, OURS: _OURS, PUSH: _PUSH, STACK: _STACK, DEEP: _DEEP, ENTRIES: _ENTRIES
}  # fmt: skip


def recipe_for(vocabulary: Vocabulary) -> str:
    """The recipe for programs with these words, unless another one is chosen."""
    if ZONE in vocabulary.by_group:
        return ENTRIES
    if vocabulary.moves_objects:
        return STACK if ON in vocabulary.relations else PUSH
    return DEEP if vocabulary.avoids or len(vocabulary.relations) > 1 else OURS


def _defaults(recipe: str, algorithm: str) -> dict[str, Settings]:
    """The parts `learner` and `network` as a recipe and an algorithm have them."""
    values = nested({**RECIPES[recipe], **ALGORITHMS[algorithm].values.get(recipe, {})})
    parts = {"learner": ALGORITHMS[algorithm].config(), "network": NetworkSettings()}
    return {name: part.changed(**values.get(name, {})) for name, part in parts.items()}


_USUAL: dict[str, Any] = _defaults(OURS, DPG)


class LearningSettings(Settings):
    """How to learn, and with which networks.

    A recipe is a named set of defaults: `LearningSettings(recipe="paper", **{"learner.updates.
    discount": 0.9})` is the paper's recipe but for one setting. The algorithm decides which
    settings `learner` has. In `changed`, every setting that is not named keeps its value, also
    where the recipe's name changes.
    """

    recipe: Annotated[str, OneOf(lambda: RECIPES)] = Field(
        OURS,
        description="named set of defaults for `learner` and `network`: the paper's, ours, or ours "
        "for programs that move objects (push), put them on each other (stack), avoid some or have "
        "several relations (deep), or move the hand among small zones (entries)",
    )
    algorithm: Annotated[str, OneOf(lambda: ALGORITHMS)] = Field(
        DPG, description="learning algorithm"
    )
    learner: LearnerConfig = _USUAL["learner"]
    network: NetworkSettings = _USUAL["network"]

    @model_validator(mode="before")
    @classmethod
    def _follow_the_recipe(cls, values: Any) -> Any:
        """Give every setting of the two parts that is absent the recipe's value."""
        if not isinstance(values, Mapping):
            return values
        values = nested(values)
        if "protocol" in values:  # its older name
            values["recipe"] = values.pop("protocol")
        recipe, algorithm = values.get("recipe") or OURS, values.get("algorithm", DPG)
        names = isinstance(recipe, str) and isinstance(algorithm, str)
        if names and recipe in RECIPES and algorithm in ALGORITHMS:  # else rejected by name
            for name, part in _defaults(recipe, algorithm).items():
                given = values.get(name, {})
                if isinstance(given, Mapping):
                    values[name] = part.changed(**given)
        return values

    @model_validator(mode="after")
    def _algorithms_own(self) -> Self:
        kind = ALGORITHMS[self.algorithm].config
        if type(self.learner) is not kind:
            raise ValueError(
                f"learner: expected {kind.__name__}, got {type(self.learner).__name__}"
            )
        return self
