"""The structured observation: Ω and the program as arrays, for any RL library.

A pure function of what an agent sees and of its program, so that a policy trained on
`pa_ros/Reach-v0` can be scored outside of it, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from pa_ros.arena.conditions import condition_named, conditions_for
from pa_ros.arena.designs import Design
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Observation
from pa_ros.language import Program
from pa_ros.language.flat import COPY, compile_program
from pa_ros.world.world import World

PROGRAM_ROWS = 24  # instructions; the paper's conditions need 11, random programs 6 deep about 16
MOST_ROWS = 4096
OPERATIONS = 4


class StructuredObservation:
    """A `Dict` whose size is the same under every condition of a design.

    - `objects` float32 [N, F]: the columns of Ω, the hand's first; rows of absent blocks are zero.
    - `arm` float32 [A]: the arm's features.
    - `program` int64 [3 · L]: the flat form (docs/DESIGN.md, "Programs"), `op`, `a`, `b` of one
      instruction after the other; the last register is p, copied until the end.
    - `relation`: its number, where the design has several.
    """

    def __init__(self, world: World, design: Design, program_rows: int = PROGRAM_ROWS) -> None:
        """ConfigError for a number of rows that no program needs."""
        if type(program_rows) is not int or not 1 <= program_rows <= MOST_ROWS:
            raise ConfigError(
                f"gym: program_rows: expected an integer of 1 to {MOST_ROWS}, got {program_rows!r}"
            )
        self._world = world
        self._vocabulary, self._rows = design.vocabulary, program_rows
        blocks = (condition_named(name, design).n_blocks for name in conditions_for(design))
        self._objects = np.zeros((1 + max(blocks), world.object_features), np.float32)
        registers = len(self._vocabulary.words) + 1 + program_rows
        numbers = np.tile([OPERATIONS, registers, registers], program_rows)
        parts: dict[str, spaces.Space[Any]] = {
            "objects": spaces.Box(-np.inf, np.inf, self._objects.shape, np.float32),
            "arm": spaces.Box(-np.inf, np.inf, (world.arm_features,), np.float32),
            "program": spaces.MultiDiscrete(numbers),
        }
        if len(self._vocabulary.relations) > 1:
            parts["relation"] = spaces.Discrete(len(self._vocabulary.relations))
        self.space = spaces.Dict(parts)

    def __call__(self, observation: Observation, program: Program) -> dict[str, Any]:
        """ConfigError for a program of more instructions than there is room for."""
        objects, hand = self._objects.copy(), observation.hand_index
        seen = np.roll(observation.objects, -hand, axis=0)  # the hand first
        objects[: len(seen)] = seen
        parts = {
            "objects": objects,
            "arm": self._world.arm(observation),
            "program": self._instructions(program),
        }
        if "relation" in self.space.spaces:
            parts["relation"] = np.int64(self._vocabulary.relations.index(program.relation))
        return parts

    def _instructions(self, program: Program) -> np.ndarray[Any, np.dtype[np.int64]]:
        flat = compile_program(program, self._vocabulary)
        if len(flat) > self._rows:
            raise ConfigError(
                f"gym: program_rows: expected at least {len(flat)} for {program}, got {self._rows}"
            )
        result = len(self._vocabulary.words) + len(flat)  # the register of p
        rows = np.tile(np.array([COPY, result, result], np.int64), (self._rows, 1))
        rows[: len(flat)] = np.stack([flat.op, flat.a, flat.b], -1)
        return rows.ravel()
