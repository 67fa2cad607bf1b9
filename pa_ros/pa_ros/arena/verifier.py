"""The verifier: does the true state satisfy a program? Privileged by definition."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt

from pa_ros.arena.designs import Kind
from pa_ros.core.experience import Float32
from pa_ros.language import Program, require_target


class Verifier:
    """Scores states under one program in one scene (paper, section "Programmable reaching").

    NEAR holds when the distance from the hand to the nearest object that the program names is at
    most the threshold. The distance is the norm of the object's position feature: from the
    origin of the hand frame (the middle of the white geom) to the block's center.
    """

    def __init__(self, program: Program, kinds: Sequence[Kind], threshold_m: float) -> None:
        """`kinds` are the blocks, objects 1, 2, …; raises NamesNothingError if none is named."""
        named = require_target(program, [kind.words for kind in kinds], None)
        self.program = program
        self.targets = tuple(i for i, is_named in enumerate(named, start=1) if is_named)
        self._threshold_m = threshold_m

    def distance(self, objects: Float32) -> float:
        """Metres from the hand to the nearest named object; `objects` is Ω, [N, 16] float32."""
        nearest = inf
        for index in self.targets:
            x, y, z = objects[index, :3].tolist()
            nearest = min(nearest, sqrt(x * x + y * y + z * z))
        return nearest

    def satisfied(self, distance_m: float) -> bool:
        return distance_m <= self._threshold_m
