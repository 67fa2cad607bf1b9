"""Which arena: settings of all that builds one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import PRESETS, ArenaConfig, preset_named
from pa_ros.arena.designs import DESIGNS, Design, design_named
from pa_ros.core.settings import OneOf, Settings
from pa_ros.world.relations import RELATIONS


class ArenaChoice(Settings):
    """A design, an arm and a preset, by name."""

    design: Annotated[str, OneOf(lambda: DESIGNS)] = Field(
        "2-L", description="which blocks there are, and which programs are held out"
    )
    relations: tuple[Annotated[str, OneOf(lambda: RELATIONS)], ...] = Field(
        (), description="that programs ask for; none: the design's own, which is NEAR in the paper"
    )
    arm: Annotated[str, OneOf(lambda: ARMS)] = Field("jaco", description="in the middle")
    preset: Annotated[str, OneOf(lambda: PRESETS)] = Field(
        "fast", description="the arm's speed, and whether it touches blocks"
    )

    def design_of(self) -> Design:
        """The design, with these relations."""
        design = design_named(self.design)
        return design.with_relations(*self.relations) if self.relations else design

    def arena_config(self) -> ArenaConfig:
        """The arm's preset; ConfigError where it has none of that name."""
        return preset_named(self.preset, self.arm)
