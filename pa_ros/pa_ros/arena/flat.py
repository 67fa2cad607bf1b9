"""The flat observation: what a standard network needs, for any RL library.

A function of what an agent sees and of the task that it is at, so that a policy trained on
`pa_ros/Reach-v0` can be scored outside of it, too.
"""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from pa_ros.arena.designs import Design
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float32, Observation
from pa_ros.world.world import World


class FlatObservation:
    """A vector, float32 [A + F · K + V + R]: the arm's A features; F features for each of the K
    kinds of block in the design, always at the same place and zero if absent (paper, appendix
    "Canonical"); 1 at the V vocabulary words that describe the target; where the design has several
    relations, 1 at the one of the R that is asked for.
    """

    def __init__(self, world: World, design: Design, condition: str = "train") -> None:
        """Under "train" and "eval" there is no place for the kinds that are met elsewhere alone."""
        self._world, self._vocabulary = world, design.vocabulary
        kinds = design.pool if condition in ("train", "eval") else design.extended_pool
        self._slot = {kind: i for i, kind in enumerate(kinds)}
        size = world.arm_features + world.object_features * len(self._slot)
        size += len(self._vocabulary.words) + self._vocabulary.relation_inputs
        self.space = spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def __call__(self, observation: Observation, task: ReachTask) -> Float32:
        """Of an observation of the episode that the task is at."""
        slots = np.zeros((len(self._slot), self._world.object_features), dtype=np.float32)
        for block, row in zip(task.episode.blocks, observation.objects[1:], strict=True):
            slots[self._slot[block.kind]] = row
        return np.concatenate([self._world.arm(observation), slots.ravel(), self._goal(task)])

    def _goal(self, task: ReachTask) -> Float32:
        """What is asked for, [V + R]."""
        vocabulary = self._vocabulary
        words = np.zeros(len(vocabulary.words), dtype=np.float32)
        target = task.episode.blocks[task.verifier.targets[0] - 1].kind
        words[[vocabulary.row[word] for word in target.words if word in vocabulary.row]] = 1.0
        relations = np.zeros(vocabulary.relation_inputs, dtype=np.float32)
        if len(relations):
            relations[vocabulary.relation_row[task.program.relation]] = 1.0
        return np.concatenate([words, relations])
