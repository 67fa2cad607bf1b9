"""Parameters of sim_node."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Self

from pydantic import Field, model_validator

from pa_ros.arena import (
    ArenaChoice,
    ArenaConfig,
    Condition,
    Design,
    condition_named,
)
from pa_ros.arena.camera import CameraConfig
from pa_ros.core.extensions import NodeSettings
from pa_ros.perception import TOLD
from pa_ros.world import reward_from

LONGEST_S = 1e6  # of any period; 11 days
ENDLESS = 2**31 - 1  # steps; 6.8 years at 10 Hz
LAST_EPISODE = 2**62  # that one may begin with; those after it fit a message, too


class SimConfig(NodeSettings, ArenaChoice):
    """One arena on the graph."""

    mode: Literal["lockstep", "real_time"] = Field(
        "lockstep", description="what paces it: answers to its observations, or the clock"
    )
    seed: int = Field(0, ge=0, description="of all episodes")
    blocks: int = Field(0, ge=0, description="on the table; 0: as the design says")
    condition: str = Field("train", description="that episodes are drawn from")
    perception: str = Field(
        TOLD,
        description="what blocks are: told, or seen by new cameras above (camera), in a corner, "
        "or both, or by the cameras of this checkpoint",
    )
    program_source: Literal["generator", "topic"] = Field(
        "generator", description="topic: execute what comes, in a scene that stays"
    )
    episode_steps: int = Field(
        0, ge=0, le=ENDLESS, description="0: the preset's; without end where programs come by topic"
    )
    first_episode: int = Field(
        0,
        ge=0,
        le=LAST_EPISODE,
        description="number of the first training episode, where a resumed run continues",
    )
    eval_every_episodes: int = Field(
        0, ge=0, description="a greedy episode after every so many training episodes; 0: none"
    )
    eval_condition: str = Field("eval", description="that greedy episodes are drawn from")
    paused: bool = Field(
        False, description="from the start, until set_simulation_state says PLAYING"
    )
    real_time_factor: float = Field(
        1.0, ge=0.01, le=100, description="simulation time per wall time, in real time"
    )
    command_timeout_s: float = Field(
        0.3, gt=0, le=LONGEST_S, description="of simulation time; then the arm holds (real time)"
    )
    resend_period_s: float = Field(
        1.0,
        gt=0,
        le=LONGEST_S,
        description="wall time; an observation left unanswered is sent again (lockstep)",
    )

    camera: CameraConfig = CameraConfig()

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        """ConfigError for an unknown condition or reward, or a number of blocks that cannot be."""
        reward_from(self.reward)
        for condition in (self.condition, *self.evaluations):
            self.condition_of(condition)
        self.arena_config()
        return self

    @property
    def evaluations(self) -> tuple[str, ...]:
        """Conditions of the greedy episodes, if there are any."""
        return (self.eval_condition,) if self.eval_every_episodes else ()

    def design_of(self) -> Design:
        """The design, with this number of blocks."""
        design = super().design_of()
        return replace(design, n_blocks=self.blocks) if self.blocks else design

    def condition_of(self, name: str) -> Condition:
        """A condition of the design; ConfigError if the design has none of that name."""
        return condition_named(name, self.design_of())

    def arena_config(self) -> ArenaConfig:
        """The preset, with the episodes' length that applies."""
        preset = super().arena_config()
        if self.episode_steps:
            return preset.changed(episode_steps=self.episode_steps)
        return preset.changed(episode_steps=ENDLESS) if self.program_source == "topic" else preset
