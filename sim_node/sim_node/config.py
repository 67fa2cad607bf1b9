"""Parameters of sim_node."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pa_ros.arena import (
    ArenaConfig,
    Condition,
    Design,
    condition_named,
    design_named,
    preset_named,
)
from pa_ros.core.errors import ConfigError

MODES = ("lockstep", "real_time")
SOURCES = ("generator", "topic")
ENDLESS = 2**31 - 1  # steps; 6.8 years at 10 Hz


@dataclass(frozen=True)
class SimConfig:
    """One arena on the graph."""

    mode: str = "lockstep"
    design: str = "2-L"
    preset: str = "fast"
    seed: int = 0
    blocks: int = 0  # on the table; 0: as the design says
    condition: str = "train"  # that episodes are drawn from
    program_source: str = "generator"  # "topic": execute what comes, in a scene that stays
    episode_steps: int = 0  # 0: the preset's; without end where programs come by topic
    first_episode: int = 0  # number of the first training episode; a resumed run goes on
    eval_every_episodes: int = 0  # greedy episode after every so many training episodes; 0: none
    eval_condition: str = "eval"  # that those are drawn from
    paused: bool = False  # from the start, until the service `pause` lets it go
    real_time_factor: float = 1.0
    command_timeout_s: float = 0.3  # of simulation time; then the arm holds (real time)
    resend_period_s: float = 1.0  # an observation left unanswered is sent again (lockstep)

    def __post_init__(self) -> None:
        for name, allowed in (("mode", MODES), ("program_source", SOURCES)):
            if getattr(self, name) not in allowed:
                raise ConfigError(f"{name}: expected one of {allowed}, got {getattr(self, name)!r}")
        for name in ("seed", "blocks", "episode_steps", "first_episode", "eval_every_episodes"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name}: expected at least 0, got {getattr(self, name)}")
        if not 0.01 <= self.real_time_factor <= 100.0:
            raise ConfigError(
                f"real_time_factor: expected 0.01 to 100, got {self.real_time_factor}"
            )
        for name in ("command_timeout_s", "resend_period_s"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ConfigError(f"{name}: expected a positive time, got {getattr(self, name)}")
        # Raises for an unknown name or a number of blocks that cannot be.
        for condition in (self.condition, *self.evaluations):
            self.condition_of(condition)
        self.arena_config()

    @property
    def evaluations(self) -> tuple[str, ...]:
        """Conditions of the greedy episodes, if there are any."""
        return (self.eval_condition,) if self.eval_every_episodes else ()

    def design_of(self) -> Design:
        """The design, with this number of blocks."""
        design = design_named(self.design)
        return replace(design, n_blocks=self.blocks) if self.blocks else design

    def condition_of(self, name: str) -> Condition:
        """A condition of the design; ConfigError if the design has none of that name."""
        return condition_named(name, self.design_of())

    def arena_config(self) -> ArenaConfig:
        """The preset, with the episodes' length that applies."""
        preset = preset_named(self.preset)
        if self.episode_steps:
            return replace(preset, episode_steps=self.episode_steps)
        return replace(preset, episode_steps=ENDLESS) if self.program_source == "topic" else preset
