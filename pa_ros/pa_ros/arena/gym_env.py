"""The reaching task as a Gymnasium environment, `pa_ros/Reach-v0`, for any RL library."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pa_ros.arena.conditions import condition_named
from pa_ros.arena.config import ArenaConfig, preset_for
from pa_ros.arena.designs import Design, design_named
from pa_ros.arena.observations import PROGRAM_ROWS, FlatObservation, StructuredObservation
from pa_ros.arena.render import top_view
from pa_ros.arena.task import ReachTask, world_of
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation, Verdict
from pa_ros.language import parse
from pa_ros.world import Reward
from pa_ros.world.reward import reward_from

ENV_ID = "pa_ros/Reach-v0"
SEED_RANGE = 2**31 - 1


class ReachEnv(gymnasium.Env[Any, Float32]):
    """Reach for one named block, or push it to another one or to a place.

    Observations are vectors, or with `observation="structured"` a `Dict` of objects, arm and
    program, for programs of any kind (`pa_ros.arena.observations`). Actions [J] in [-1, 1] are
    parts of the joint speed limits, or [3] of the hand's speed (`pa_ros.world.controller`). The
    reward is ±1, or that of `reward`: a `Reward`, its name, or its JSON. Episodes are truncated,
    never terminated. `info` contains the program, the distance (m) and `is_success`.
    `copy.deepcopy` makes an independent copy in the same state; pickle works only before the first
    reset.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        preset: str | ArenaConfig = "",
        design: str | Design = "2-L",
        condition: str = "train",
        render_mode: str | None = None,
        reward: Reward | str | None = None,
        arm: str = "",
        observation: Literal["flat", "structured"] = "flat",
        program_rows: int = PROGRAM_ROWS,
        relations: Sequence[str] = (),
    ) -> None:
        """`relations` are those of the programs; empty: the design's own. `preset` is the design's
        by default, `arm` the preset's; an ArenaConfig contains its own. `program_rows` is the
        number of instructions in a structured observation."""
        if observation not in ("flat", "structured"):
            raise ConfigError(f"gym: observation: expected flat or structured, got {observation!r}")
        self.design = design if isinstance(design, Design) else design_named(design)
        if relations:
            self.design = self.design.with_relations(*relations)
        if not isinstance(preset, ArenaConfig):
            preset = preset_for(self.design, preset, arm)
        self.config = preset
        if arm not in ("", self.config.arm):
            raise ConfigError(
                f"gym: arm: expected none beside an ArenaConfig of {self.config.arm}, got {arm!r}"
            )
        self._reward = reward_from(reward) if isinstance(reward, str) else reward
        self.condition, self.render_mode = condition, render_mode
        self.world = world_of(self.config, self.design)
        self.flat = FlatObservation(self.world, self.design, condition)
        self.observation_space: spaces.Space[Any] = self.flat.space
        self.structured: StructuredObservation | None = None
        if observation == "structured":
            self.structured = StructuredObservation(self.world, self.design, program_rows)
            self.observation_space = self.structured.space
        elif (drawn := condition_named(condition, self.design)).avoided or drawn.formula:
            raise ConfigError(
                f"gym: condition {condition!r} of {self.design.name}: expected one that avoids "
                "nothing, as a flat observation does not say what (observation='structured' does)"
            )
        self.action_space = spaces.Box(-1.0, 1.0, (self.world.actions,), np.float32)
        self._limits = np.array(self.config.command_limits)
        self._task: ReachTask | None = None
        self._next_episode = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start the next episode, or with a seed, episode 0 of that seed.

        `options={"program": text}` replaces the program of the episode. Raises ProgramError for a
        wrong program or one that names no block of the episode, ConfigError for one that a flat
        observation cannot state, and for other options.
        """
        chosen = dict(options or {})
        program = chosen.pop("program", None)
        if chosen:
            raise ConfigError(f"gym: options: expected only 'program', got {[*map(str, chosen)]}")
        parsed = None if program is None else parse(str(program), self.world.vocabulary)
        super().reset(seed=seed)
        if seed is not None or self._task is None:
            # Gymnasium's generator draws the arena's seed, so that `reset(seed=…)` determines all
            # episodes.
            drawn = int(self.np_random.integers(SEED_RANGE))
            self._task = ReachTask(self.config, self.design, drawn, self._reward)
            self._next_episode = 0
        observation, verdict = self._task.reset(self._next_episode, self.condition)
        self._next_episode += 1
        if parsed is not None:
            observation, verdict = self._task.set_program(parsed)
            if self.structured is None:
                self.flat.check(self._task)
        return self._observed(observation), self._info(verdict)

    def step(self, action: Float32) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act for one control period; ArenaError (arena.command) unless all numbers are finite."""
        joints = self.task.simulation.joint_position
        command = self.world.joint_action(action, joints)
        observation, verdict = self.task.step(self._limits * command)
        seen, info = self._observed(observation), self._info(verdict)
        return seen, verdict.reward, False, verdict.truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """A top view [480, 480, 3] if `render_mode` is "rgb_array"; does not need OpenGL."""
        return top_view(self.task, 480) if self.render_mode == "rgb_array" else None

    @property
    def task(self) -> ReachTask:
        """The underlying task; ConfigError before the first reset."""
        if self._task is None:
            raise ConfigError("gym: expected a reset before the first step")
        return self._task

    def _observed(self, seen: Observation) -> Any:
        if self.structured is not None:
            return self.structured(seen, self.task.program)
        return self.flat(seen, self.task)

    def _info(self, verdict: Verdict) -> dict[str, Any]:
        return {
            "program": str(self.task.program),
            "distance": verdict.distance,
            "is_success": verdict.satisfied,
        }


def register() -> None:
    """Register the environment for `gymnasium.make`; importing pa_ros.arena calls this."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(ENV_ID, entry_point=f"{__name__}:{ReachEnv.__name__}")
