"""Which arena: settings of all that builds one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import PRESETS, ArenaConfig, preset_named
from pa_ros.arena.designs import DESIGNS
from pa_ros.core.settings import OneOf, Settings
from pa_ros.language.syntax import NEAR
from pa_ros.world.relations import RELATIONS


class ArenaChoice(Settings):
    """A design, an arm and a preset, by name."""

    design: Annotated[str, OneOf(lambda: DESIGNS)] = Field(
        "2-L", description="which blocks there are, and which programs are held out"
    )
    relations: tuple[Annotated[str, OneOf(lambda: RELATIONS)], ...] = Field(
        (NEAR,), description="that programs ask for, in the order of their embeddings"
    )
    arm: Annotated[str, OneOf(lambda: ARMS)] = Field("jaco", description="in the middle")
    preset: Annotated[str, OneOf(lambda: PRESETS)] = Field(
        "fast", description="the arm's speed, and whether it touches blocks"
    )

    def arena_config(self) -> ArenaConfig:
        """The arm's preset; ConfigError where it has none of that name."""
        return preset_named(self.preset, self.arm)
