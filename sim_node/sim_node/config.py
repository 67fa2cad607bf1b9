"""Parameters of sim_node."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Self

from pydantic import Field, model_validator

from pa_ros.arena import (
    ArenaChoice,
    ArenaConfig,
    Design,
    condition_named,
)
from pa_ros.arena.camera import CameraConfig
from pa_ros.core.experience import ENDLESS
from pa_ros.perception import TOLD
from pa_ros.ros.settings import NodeSettings
from pa_ros.world import reward_from

LONGEST_S = 1e6  # of any period; 11 days
LAST_EPISODE = 2**62  # that one may begin with; those after it fit a message, too


class SimConfig(NodeSettings, ArenaChoice):
    """One arena on the graph."""

    mode: Literal["lockstep", "real_time"] = Field(
        "lockstep", description="lockstep: a step for each command; real_time: by the clock"
    )
    seed: int = Field(0, ge=0, description="of all episodes")
    blocks: int = Field(0, ge=0, description="number of blocks on the table; 0: the design's")
    condition: str = Field("train", description="condition of the training episodes")
    perception: str = Field(
        TOLD,
        description="how blocks' properties are known: told; camera, corner or both: by new "
        "cameras above the table, in a corner, or both; a checkpoint: by its cameras",
    )
    program_source: Literal["generator", "topic"] = Field(
        "generator",
        description="generator: programs are drawn; topic: they are sent, for one scene",
    )
    episode_steps: int = Field(
        0, ge=0, le=ENDLESS, description="0: the preset's; no limit if program_source is topic"
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
    eval_condition: str = Field("eval", description="condition of the greedy episodes")
    paused: bool = Field(False, description="start paused, until set_simulation_state says PLAYING")
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
        condition_named(self.condition, self.design_of())
        if self.eval_every_episodes:
            condition_named(self.eval_condition, self.design_of())
        self.arena_config()
        return self

    def design_of(self) -> Design:
        """The design, with this number of blocks."""
        design = super().design_of()
        return replace(design, n_blocks=self.blocks) if self.blocks else design

    def arena_config(self) -> ArenaConfig:
        """The preset, with the episodes' length that applies."""
        preset = super().arena_config()
        if self.episode_steps:
            return preset.changed(episode_steps=self.episode_steps)
        return preset.changed(episode_steps=ENDLESS) if self.program_source == "topic" else preset
