"""Which arena: settings of all that builds one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pa_ros.arena.config import PRESETS
from pa_ros.arena.designs import DESIGNS
from pa_ros.core.settings import OneOf, Settings
from pa_ros.language.syntax import NEAR
from pa_ros.world.relations import RELATIONS


class ArenaChoice(Settings):
    """A design and an arm, by name."""

    design: Annotated[str, OneOf(lambda: DESIGNS)] = Field(
        "2-L", description="which blocks there are, and which programs are held out"
    )
    relations: tuple[Annotated[str, OneOf(lambda: RELATIONS)], ...] = Field(
        (NEAR,), description="that programs ask for, in the order of their embeddings"
    )
    preset: Annotated[str, OneOf(lambda: PRESETS)] = Field("fast", description="of the arm")
