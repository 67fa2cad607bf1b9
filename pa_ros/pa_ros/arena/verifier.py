"""The verifier: does the true state satisfy a program? Privileged by definition."""

from __future__ import annotations

from collections.abc import Sequence

from pa_ros.arena.designs import Kind
from pa_ros.core.experience import Float32
from pa_ros.language import Program, require_target
from pa_ros.world import Score, Scoring


class Verifier:
    """Scores states under one program in one scene (paper, section "Programmable reaching")."""

    def __init__(self, program: Program, kinds: Sequence[Kind], scoring: Scoring) -> None:
        """`kinds` are the blocks, objects 1, 2, …; raises NamesNothingError if none is named."""
        named = require_target(program, [kind.words for kind in kinds], None)
        self.program = program
        self.targets = tuple(i for i, is_named in enumerate(named, start=1) if is_named)
        self._scoring = scoring

    def score(self, objects: Float32) -> Score:
        """Of one state: `objects` is Ω, [N, 16] float32."""
        return self._scoring.of_targets(self.targets, objects)
