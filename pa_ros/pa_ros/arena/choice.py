"""Which arena: settings of all that builds one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pa_ros.arena.config import PRESETS
from pa_ros.arena.designs import DESIGNS
from pa_ros.core.settings import OneOf, Settings


class ArenaChoice(Settings):
    """A design and an arm, by name."""

    design: Annotated[str, OneOf(lambda: DESIGNS)] = Field(
        "2-L", description="which blocks there are, and which programs are held out"
    )
    preset: Annotated[str, OneOf(lambda: PRESETS)] = Field("fast", description="of the arm")
