"""The entities of an arena by name, without ROS."""

import numpy as np
import pytest

from pa_ros.core.experience import Body
from pa_ros.language import ProgramError
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.simulator import Category, EntityFilter, ResultCode, Spawning
from pa_ros.wire.views import OPTICAL_FRAME
from sim_node.config import SimConfig
from sim_node.entities import Entities, solids
from sim_node.session import Session, SimulatorError

FLAT = np.array([0.0, 0.0, 0.0, 1.0])


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
    body = Body.at_rest(np.array([x, y, 0.0]), FLAT)
    entities.spawn(Spawning(name, False, uri, body))


def test_names_match_posix_extended_expressions(entities: Entities) -> None:
    assert names(entities, "^red_c") == ["red_cube"]
    assert names(entities, "^h.nd$|^red_[[:alpha:]]+be$") == ["hand", "red_cube"]
    assert names(entities) == names(entities, "_?")


@pytest.mark.parametrize("pattern", ["(", "(?=a)"])
def test_a_wrong_expression_is_rejected(entities: Entities, pattern: str) -> None:
    with pytest.raises(SimulatorError, match=r"^filters\.filter: expected .*, got ") as caught:
        names(entities, pattern)
    assert caught.value.result == ResultCode.OPERATION_FAILED


def test_an_expression_takes_linear_time(entities: Entities) -> None:
    spawn(entities, "a" * 200, -0.5, -0.5)
    assert names(entities, "^(a+)+!$") == []


@pytest.mark.parametrize("name", ["hand", "hand_link", "link1", "base", "world", OPTICAL_FRAME])
def test_a_block_is_not_named_as_another_frame(entities: Entities, name: str) -> None:
    with pytest.raises(SimulatorError, match=f"got '{name}'"):
        spawn(entities, name, -0.5, -0.5)


def test_a_restart_keeps_or_removes_added_blocks(session: Session, entities: Entities) -> None:
    spawn(entities, "mine", -0.5, -0.5)
    entities.put("mine", Body.at_rest(np.array([0.5, 0.5, 0.1]), FLAT))
    entities.restart(session.begin, keep_spawned=True)
    assert entities.named("mine").body.position[:2] == pytest.approx([-0.5, -0.5])
    entities.restart(session.begin, keep_spawned=False)
    assert "mine" not in names(entities)


def test_a_step_after_a_move_is_no_consequence_of_a_command(session: Session, entities: Entities):
    entities.put("red_cube", entities.named("red_cube").body)
    assert session.disturbed


def test_a_block_thrown_off_the_table_hinders_no_other(session: Session, entities: Entities):
    spawn(entities, "thrown", -0.5, -0.5)
    at = np.array([-0.5, -0.5, 0.0])
    entities.put("thrown", Body(at, FLAT, np.array([-3.0, 0.0, 1.0]), np.zeros(3)))
    for _ in range(5):
        session.advance(session.hold)
    assert entities.named("thrown").body.position[0] < -0.8
    entities.put("red_cube", Body.at_rest(np.array([0.5, 0.5, 0.1]), FLAT))
    spawn(entities, "other", 0.4, -0.4)
    entities.delete("other")
    entities.put("thrown", Body.at_rest(at, FLAT))
    assert entities.named("thrown").body.position[0] == -0.5


def test_places_are_entities_that_are_added_moved_shown_and_named_by_programs() -> None:
    session = Session(SimConfig(design="push-2", preset="push", seed=2), "x")
    session.begin()
    entities = Entities(session)
    found = {entity.name: entity for entity in entities.matching()}
    assert found["red_place"].category == Category.STATIC_OBJECT
    assert found["red_cube"].category == Category.DYNAMIC_OBJECT
    shown = {one.name: one for one in solids(session.task.simulation.model, [*found.values()][1:])}
    assert shown["red_place"].body.position[2] < 0.01 < shown["red_cube"].body.position[2]
    body = Body.at_rest(np.array([0.4, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    entities.put("red_place", body)
    assert entities.named("red_place").body.position == pytest.approx([0.4, 0.0, 0.03])
    entities.delete("red_place")
    with pytest.raises(ProgramError, match="no such object"):
        session.submit(ProgramRequest("a", "NEAR(AND(RED, CUBE), AND(RED, PLACE))"))
    entities.spawn(Spawning("here", False, "block:red_place", body))
    assert session.submit(ProgramRequest("b", "NEAR(AND(RED, CUBE), AND(RED, PLACE))"))
    with pytest.raises(ProgramError, match="nothing to move"):
        session.submit(ProgramRequest("c", "NEAR(PLACE, RED)"))
