"""The verifier: does the true state satisfy a program? Privileged by definition."""

from __future__ import annotations

from collections.abc import Sequence

from pa_ros.arena.designs import Kind
from pa_ros.core.experience import Float32, Float64
from pa_ros.language import Program, require_target, satisfying
from pa_ros.world import Score, Scoring


class Verifier:
    """Scores states under one program in one scene (paper, section "Programmable reaching")."""

    def __init__(
        self,
        program: Program,
        kinds: Sequence[Kind],
        scoring: Scoring,
        may_name_nothing: bool = False,
    ) -> None:
        """`kinds` are the blocks, objects 1, 2, …; raises ProgramError if none is named,
        unless that may be, and ConfigError for a relation that `scoring` doesn't know."""
        scoring.threshold(program.relation)
        check = satisfying if may_name_nothing else require_target
        named = check(program, [kind.words for kind in kinds], None)
        self.program = program
        self.targets = tuple(i for i, is_named in enumerate(named, start=1) if is_named)
        self._scoring = scoring

    def score(self, objects: Float32, hand_pose: Float64) -> Score:
        """Of one state: `objects` is Ω, [N, F] float32, `hand_pose` the hand's in the base's frame,
        [7]."""
        return self._scoring.of_targets(self.targets, objects, self.program.relation, hand_pose)
