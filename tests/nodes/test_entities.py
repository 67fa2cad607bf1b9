"""What is in the arena, by name: filters that cost little, blocks put back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena.errors import ArenaError
from pa_ros.core.body import Body
from pa_ros.wire.simulator import EntityFilter, ResultCode, Spawning
from sim_node.config import SimConfig
from sim_node.entities import Entities
from sim_node.errors import SimulatorError
from sim_node.session import Session

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


@pytest.fixture
def session() -> Session:
    session = Session(SimConfig(design="3-D", seed=2), "x")
    session.begin()
    return session


@pytest.fixture
def entities(session: Session) -> Entities:
    return Entities(session)


def names(entities: Entities, pattern: str = "") -> list[str]:
    return [entity.name for entity in entities.matching(EntityFilter(pattern))]


def spawn(entities: Entities, name: str, x: float, y: float) -> None:
    uri = next(iter(entities.spawnable()))
    entities.spawn(Spawning(name, False, uri, Body.at_rest(np.array([x, y, 0.0]), UPRIGHT)))


def test_names_are_found_by_posix_extended_expressions(entities: Entities) -> None:
    assert names(entities, "^red_c") == ["red_cube"]
    assert names(entities, "^h.nd$|^red_[[:alpha:]]+be$") == ["hand", "red_cube"]
    assert names(entities, "(red|blue)_cub{1,2}e") == ["red_cube"]
    assert names(entities) == names(entities, "_?") == [e.name for e in entities.matching()]


@pytest.mark.parametrize(
    "pattern",
    ["(", "x{4294967295}", "(" * 3000, "(" * 900, r"(\w{50}){50}", "a" * 1001, "(?=a)", r"(a)\1"],
)
def test_what_is_no_expression_or_too_large_a_one_is_refused(entities, pattern) -> None:
    with pytest.raises(SimulatorError, match=r"^filters\.filter: expected .*, got ") as refused:
        names(entities, pattern)
    assert refused.value.result == ResultCode.OPERATION_FAILED and len(str(refused.value)) < 500


@pytest.mark.parametrize("pattern", ["^(a+)+!$", "(a|aa)+!", "a*" * 300 + "!", "(a*){30}" * 20])
def test_no_expression_takes_long_whatever_the_names_are(session, entities, pattern) -> None:
    spawn(entities, "a" * 200, -0.5, -0.5)
    found = names(entities, pattern)  # by backtracking: for ever
    assert found == ([] if "!" in pattern else names(entities))


def test_what_cannot_be_put_back_is_refused_and_nothing_has_changed(session, entities) -> None:
    block = names(entities)[1]
    start = entities.named(block).body.position
    elsewhere = np.array([-0.55, -0.55, 0.05])
    entities.put(block, lambda body: replace(body, position=elsewhere))
    spawn(entities, "mine", start[0], start[1])
    frame, before = session.frame, names(entities)
    with pytest.raises(ArenaError, match="to every other block"):
        entities.restore(session.begin, spawned=True)
    assert session.frame is frame and names(entities) == before
    assert np.allclose(entities.named(block).body.position, elsewhere, atol=0.05)
    entities.restore(session.begin, spawned=False)
    assert "mine" not in names(entities)


def test_blocks_put_back_are_no_more_than_there_may_be(session, entities) -> None:
    own = names(entities)[1:]
    entities.delete(*own[1:])
    for i in range(31):
        spawn(entities, f"b{i}", -0.7 + 0.1 * (i % 8), -0.7 + 0.1 * (i // 8))
    before = names(entities)
    assert len(before) == 33
    with pytest.raises(SimulatorError, match="at most 32"):
        entities.restore(session.begin, spawned=True)
    assert names(entities) == before
