"""What is learned of programs that avoid a set: pairs of programs, and the end of violated ones."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.rejections import rejected
from helpers.worlds import NEAR_M, PROGRAMS, SCORING, WORLD, dpg, random_trajectory
from pa_ros.core.errors import ConfigError
from pa_ros.language import Program, satisfying
from pa_ros.learning.learner import Learner
from pa_ros.learning.rules.all_goals import AVOIDING as AVOIDING_SHARE
from pa_ros.learning.rules.all_goals import KEPT
from pa_ros.networks.config import NetworkConfig

AVOIDING = replace(WORLD, vocabulary=WORLD.vocabulary.avoiding())
SETTINGS = dpg(
    replay__batch_size=64,
    replay__capacity_frames=1000,
    replay__warmup_frames=0,
    relabeling__rule="all-goals",
    engine__name="torch",
    updates__per_frame=0.0,
    updates__discount=0.9,
)
BLOCKS: list[set[str]] = [set(), {"RED", "CUBE"}, {"BLUE", "SPHERE"}]


def learner(**fields: object) -> Learner:
    network = NetworkConfig(world=AVOIDING, hidden=6, attention=4)
    return Learner(network, dpg(SETTINGS, **fields), PROGRAMS, 0, SCORING)


def test_a_violation_ends_the_program_with_half_the_value_of_never_being_rewarded() -> None:
    one, rng = learner(), np.random.default_rng(0)
    seen: set[tuple[bool, bool, bool]] = set()
    for sequence in range(20):
        one.consume(random_trajectory(rng, world_digest=AVOIDING.digest, sequence=sequence))
    for batch in one.batches(8):
        distance = np.linalg.norm(batch.next_objects[..., :3].astype(np.float64), axis=-1)
        for b, row in enumerate(batch.program[:, 0]):
            program = one.table.programs[row]
            near = distance[b] <= NEAR_M
            holds = bool((near & satisfying(program, BLOCKS, 0)).any())
            lost = False
            if program.avoided is not None:
                lost = bool((near & satisfying(Program(program.avoided), BLOCKS, 0)).any())
            expected = (-5.0, 0.0) if lost else (1.0 if holds else -1.0, 0.9)
            assert (batch.reward[b, 0], batch.discount[b]) == pytest.approx(expected)
            seen.add((program.avoided is not None, lost, holds))
    assert seen == {(False, False, False), (False, False, True), (True, False, False),
                    (True, False, True), (True, True, False), (True, True, True)}  # fmt: skip


def test_no_program_avoids_its_own_target() -> None:
    one, rng = learner(), np.random.default_rng(0)
    one.consume(random_trajectory(rng, world_digest=AVOIDING.digest))
    drawn = {one.table.programs[row] for batch in one.batches(4) for row in batch.program[:, 0]}
    assert drawn == {
        *PROGRAMS,
        *(replace(p, avoided=q.target) for p in PROGRAMS for q in PROGRAMS if p != q),
    }


def test_avoiding_programs_that_acted_are_drawn_more_often_than_others() -> None:
    one, rng = learner(), np.random.default_rng(0)
    acted = replace(PROGRAMS[0], avoided=PROGRAMS[1].target)
    one.consume(random_trajectory(rng, world_digest=AVOIDING.digest, program=acted))
    drawn = [one.table.programs[row] for batch in one.batches(20) for row in batch.program[:, 0]]
    others = (1 - KEPT) * AVOIDING_SHARE / len(PROGRAMS)  # each is present, and avoids the other
    assert drawn.count(acted) / len(drawn) == pytest.approx(KEPT + others, abs=0.04)


def test_what_cannot_be_learned_is_refused() -> None:
    with pytest.raises(ConfigError, match="programs_per_transition"):
        learner(relabeling__programs_per_transition=2)
    plain = Learner(NetworkConfig(world=WORLD, hidden=6, attention=4), SETTINGS, PROGRAMS, 0)
    avoiding = replace(PROGRAMS[0], avoided=PROGRAMS[1].target)
    with rejected("program.avoids"):
        plain.consume(random_trajectory(np.random.default_rng(0), program=avoiding))
