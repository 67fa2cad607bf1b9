"""Observations for RL libraries: a flat vector, and a `Dict` with the program as arrays.

Both are functions of the observation and the task, so that a policy that was trained on
`pa_ros/Reach-v0` can be scored outside of that environment too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from pa_ros.arena.conditions import condition_named, conditions_for
from pa_ros.arena.designs import Design
from pa_ros.arena.simulation import HAND_INDEX
from pa_ros.arena.task import ReachTask
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation
from pa_ros.language import Program
from pa_ros.language.flat import COPY, Compiled, compile_program
from pa_ros.world.world import World

PROGRAM_ROWS = 24  # instructions; the paper's conditions need 11, programs of depth 6 about 16
OPERATIONS = 4


class FlatObservation:
    """A float32 vector [A + F · K + V + R] for standard networks.

    It contains the A features of the arm; the F features of each of the K kinds of block, at fixed
    places and zero if absent (paper, appendix "Canonical"); 1 at each of the V words that describe
    the target; and 1 at the program's relation, if the design has several (R). If programs move
    blocks, another V words before those of the target describe what is moved (none: the hand).
    """

    def __init__(self, world: World, design: Design, condition: str = "train") -> None:
        """The conditions "train" and "eval" have no places for the kinds that only others use."""
        self._world, self._vocabulary = world, design.vocabulary
        kinds = design.pool if condition in ("train", "eval") else design.extended_pool
        kinds += design.places
        self._slot = {kind: i for i, kind in enumerate(kinds)}
        size = world.arm_features + world.object_features * len(self._slot)
        # The verifier's sets that programs choose; else the hand is what is moved.
        self._sets = ("moved", "targets") if self._vocabulary.moves_objects else ("targets",)
        size += len(self._sets) * len(self._vocabulary.words) + self._vocabulary.relation_inputs
        self.space = spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def __call__(self, observation: Observation, task: ReachTask) -> Float32:
        """Encode an observation of the task's current episode."""
        slots = np.zeros((len(self._slot), self._world.object_features), dtype=np.float32)
        for block, row in zip(task.episode.blocks, observation.objects[1:], strict=True):
            slots[self._slot[block.kind]] = row
        return np.concatenate([self._world.arm(observation), slots.ravel(), self._asked(task)])

    def check(self, task: ReachTask) -> None:
        """Raise ConfigError unless the observation states all that the program says."""
        if task.program.avoided is not None:
            raise ConfigError(
                "gym: program: expected one that avoids nothing, as a flat observation does not "
                f"say what (observation='structured' does), got {task.program}"
            )
        for named in (task.verifier.moved, task.verifier.targets):
            words, blocks = self._words(task, named), enumerate(task.episode.blocks, start=1)
            stated = tuple(i for i, block in blocks if words <= block.kind.words)
            if named != (stated if words else (HAND_INDEX,)):
                raise ConfigError(
                    "gym: program: expected one that names a single block, as a flat observation "
                    f"states no other (observation='structured' does), got {task.program}"
                )

    def _words(self, task: ReachTask, named: tuple[int, ...]) -> frozenset[str]:
        """The words that describe the (first) object of a set; none for the hand."""
        if named[0] == HAND_INDEX:
            return frozenset()
        return task.episode.blocks[named[0] - 1].kind.words & self._vocabulary.row.keys()

    def _asked(self, task: ReachTask) -> Float32:
        """The program as words and relation, [V + R] or [2V + R]."""
        vocabulary = self._vocabulary
        words = np.zeros((len(self._sets), len(vocabulary.words)), dtype=np.float32)
        for row, name in zip(words, self._sets, strict=True):
            named = self._words(task, getattr(task.verifier, name))
            row[[vocabulary.row[word] for word in named]] = 1.0
        relations = np.zeros(vocabulary.relation_inputs, dtype=np.float32)
        if len(relations):
            relations[vocabulary.relation_row[task.program.relation]] = 1.0
        return np.concatenate([words.ravel(), relations])


class StructuredObservation:
    """A `Dict` of the same size under every condition of a design.

    - `objects` float32 [N, F]: object features, the hand's first; rows of absent blocks are zero.
    - `arm` float32 [A]: arm features.
    - `program` int64 [3 · L]: `op`, `a`, `b` of each instruction of the flat form
      (docs/DESIGN.md, "Programs"), padded with copies of the last register.
    - `relation`: index of the relation, if the design has several.
    - `sets` int64 [2]: registers of what is moved and of the target, if programs move blocks.
    - `avoided`: register of what is to be avoided, if the design's programs avoid anything; that of
      HAND: nothing.
    """

    def __init__(self, world: World, design: Design, program_rows: int = PROGRAM_ROWS) -> None:
        """`program_rows`: instructions of the longest program."""
        self._world = world
        self._vocabulary, self._rows = design.vocabulary, program_rows
        blocks = (condition_named(name, design).n_blocks for name in conditions_for(design))
        rows = 1 + max(blocks) + design.n_places
        self._objects = np.zeros((rows, world.object_features), np.float32)
        registers = len(self._vocabulary.words) + 1 + program_rows
        numbers = np.tile([OPERATIONS, registers, registers], program_rows)
        parts: dict[str, spaces.Space[Any]] = {
            "objects": spaces.Box(-np.inf, np.inf, self._objects.shape, np.float32),
            "arm": spaces.Box(-np.inf, np.inf, (world.arm_features,), np.float32),
            "program": spaces.MultiDiscrete(numbers),
        }
        if len(self._vocabulary.relations) > 1:
            parts["relation"] = spaces.Discrete(len(self._vocabulary.relations))
        if self._vocabulary.moves_objects:
            parts["sets"] = spaces.MultiDiscrete([registers, registers])
        if self._vocabulary.avoids:
            parts["avoided"] = spaces.Discrete(registers)
        self.space = spaces.Dict(parts)

    def __call__(self, observation: Observation, program: Program) -> dict[str, Any]:
        """Encode an observation; ConfigError for a program of more than `program_rows` rows."""
        objects, hand = self._objects.copy(), observation.hand_index
        # The hand's row is first in this observation, whatever its index is elsewhere.
        seen = np.roll(observation.objects, -hand, axis=0)
        objects[: len(seen)] = seen
        code = compile_program(program, self._vocabulary)
        parts: dict[str, Any] = {
            "objects": objects,
            "arm": self._world.arm(observation),
            "program": self._instructions(program, code),
        }
        if "sets" in self.space.spaces:
            parts["sets"] = np.array([code.moved, code.target], np.int64)
        if "avoided" in self.space.spaces:
            parts["avoided"] = np.int64(code.avoided)
        if "relation" in self.space.spaces:
            parts["relation"] = np.int64(code.relation)
        return parts

    def _instructions(
        self, program: Program, code: Compiled
    ) -> np.ndarray[Any, np.dtype[np.int64]]:
        length = len(code.op)
        if length > self._rows:
            raise ConfigError(
                f"gym: program_rows: expected at least {length} for {program}, got {self._rows}"
            )
        result = len(self._vocabulary.words) + length  # the register of p
        rows = np.tile(np.array([COPY, result, result], np.int64), (self._rows, 1))
        rows[:length] = np.stack([code.op, code.a, code.b], -1)
        return rows.ravel()
