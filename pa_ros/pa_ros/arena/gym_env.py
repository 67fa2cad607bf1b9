"""The reaching task as a Gymnasium environment, `pa_ros/Reach-v0`, for any RL library.

Observed as one flat vector, what a standard network needs, goal included; or as it is, structured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pa_ros.arena.config import ArenaConfig, preset_named
from pa_ros.arena.designs import Design, design_named
from pa_ros.arena.errors import CommandError
from pa_ros.arena.flat import FlatObservation
from pa_ros.arena.render import top_view
from pa_ros.arena.structured import PROGRAM_ROWS, StructuredObservation
from pa_ros.arena.task import ReachTask, world_of
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation, Verdict
from pa_ros.language import parse
from pa_ros.world import Reward
from pa_ros.world.reward import reward_from

ENV_ID = "pa_ros/Reach-v0"
SEED_RANGE = 2**31 - 1


class ReachEnv(gymnasium.Env[Any, Float32]):
    """Reach for one named block.

    Observation: a vector (`pa_ros.arena.flat`). Action, [J] in [-1, 1]:
    parts of the joint speed limits. With `observation="structured"` a `Dict` of objects, arm and
    program (`pa_ros.arena.structured`), for programs of any kind. Reward ±1, or as `reward` has
    it: one of `pa_ros.world`'s, its name, or its JSON. Episodes are truncated, never terminated.
    `info` has the program, the distance (m) and whether it is satisfied. `copy.deepcopy` makes one
    that goes on by itself from the same state; pickle refuses one that was reset (ConfigError).
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        preset: str | ArenaConfig = "fast",
        design: str | Design = "2-C",
        condition: str = "train",
        render_mode: str | None = None,
        reward: Reward | str | None = None,
        arm: str | None = None,
        observation: Literal["flat", "structured"] = "flat",
        program_rows: int = PROGRAM_ROWS,
    ) -> None:
        """`arm`: "jaco" unless given; an ArenaConfig has its own. `program_rows`: instructions that
        there is room for in a structured observation."""
        if observation not in ("flat", "structured"):
            raise ConfigError(f"gym: observation: expected flat or structured, got {observation!r}")
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"gym: render_mode: expected None or rgb_array, got {render_mode!r}")
        own = preset if isinstance(preset, ArenaConfig) else preset_named(preset, arm or "jaco")
        if arm not in (None, own.arm):
            raise ConfigError(
                f"gym: arm: expected none beside an ArenaConfig of {own.arm}, got {arm!r}"
            )
        self.config = own
        self.design = design if isinstance(design, Design) else design_named(design)
        reward = reward_from(reward) if isinstance(reward, str) else reward
        if not isinstance(reward, (Reward, type(None))):
            raise ConfigError(f"gym: reward: expected a Reward or a name of one, got {reward!r}")
        self.condition, self.render_mode, self._reward = condition, render_mode, reward
        self.world = world_of(self.config, self.design)
        self.flat = FlatObservation(self.world, self.design, condition)
        self.observation_space: spaces.Space[Any] = self.flat.space
        self.structured: StructuredObservation | None = None
        if observation == "structured":
            self.structured = StructuredObservation(self.world, self.design, program_rows)
            self.observation_space = self.structured.space
        self.action_space = spaces.Box(-1.0, 1.0, (self.world.actions,), np.float32)
        self._limits = np.array(self.config.joint_speed_limits)
        self._task: ReachTask | None = None
        self._next_episode = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Next episode; with a seed, episode 0 of that seed.

        `options`: {"program": its text} in place of the episode's own. Raises ConfigError for other
        options, ProgramError for a text that is none, and ProgramError for one that names none
        of the blocks of that episode, which begins all the same.
        """
        if not isinstance(options, (Mapping, type(None))):
            raise ConfigError(f"gym: options: expected a mapping, got {options!r}")
        asked = dict(options or {})
        program = asked.pop("program", None)
        if asked:
            raise ConfigError(
                f"gym: options: expected 'program' alone, got {sorted(map(str, asked))}"
            )
        parsed = None if program is None else parse(str(program), self.world.vocabulary)
        super().reset(seed=seed)
        if seed is not None or self._task is None:
            drawn = int(self.np_random.integers(SEED_RANGE))
            self._task, self._next_episode = self._new_task(drawn), 0
        observation, verdict = self._task.reset(self._next_episode, self.condition)
        self._next_episode += 1
        if parsed is not None:
            observation, verdict = self._task.set_program(parsed)
        return self._observed(observation), self._info(verdict)

    def step(self, action: Float32) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Raises CommandError for an action that is not [J] finite numbers; then nothing moves."""
        expected = f"gym: action: expected [{len(self._limits)}] numbers in [-1, 1], got"
        try:
            if np.iscomplexobj(action):
                raise TypeError("complex numbers")
            parts = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise CommandError(f"{expected} {type(action).__name__}: {error}") from error
        if parts.shape != self._limits.shape:
            raise CommandError(f"{expected} {list(parts.shape)}")
        observation, verdict = self.task.step(parts * self._limits)
        seen, info = self._observed(observation), self._info(verdict)
        return seen, verdict.reward, False, verdict.truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Top view [480, 480, 3] if `render_mode` is "rgb_array"; needs no OpenGL."""
        return top_view(self.task, 480) if self.render_mode == "rgb_array" else None

    @property
    def task(self) -> ReachTask:
        """The task underneath; ConfigError before the first reset."""
        if self._task is None:
            raise ConfigError("gym: expected a reset before the first step")
        return self._task

    def _observed(self, seen: Observation) -> Any:
        if self.structured is not None:
            return self.structured(seen, self.task.program)
        return self.flat(seen, self.task)

    def _new_task(self, seed: int) -> ReachTask:
        return ReachTask(self.config, self.design, seed, reward=self._reward)

    def _info(self, verdict: Verdict) -> dict[str, Any]:
        return {
            "program": str(self.task.program),
            "distance": verdict.distance,
            "is_success": verdict.satisfied,
        }


def register() -> None:
    """Make `gymnasium.make("pa_ros/Reach-v0")` work; importing pa_ros.arena calls it."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(ENV_ID, entry_point=f"{__name__}:{ReachEnv.__name__}")
