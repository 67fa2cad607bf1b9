"""The standard services of a simulator: what is asked, and entities as they are shown."""

from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from simulation_interfaces.msg import Bounds
from simulation_interfaces.srv import GetEntities, SpawnEntity, StepSimulation
from visualization_msgs.msg import Marker

from helpers.messages import same
from helpers.rejections import rejected
from pa_ros.core.experience import Body
from pa_ros.wire.fields import write_vector
from pa_ros.wire.simulator import (
    MAX_STEPS,
    SimState,
    decode_filters,
    decode_simulation_state,
    decode_simulation_steps,
    decode_spawning,
    decode_state_change,
    encode_state_change,
    encode_state_request,
    encode_steps_goal,
)
from pa_ros.wire.views import Solid, encode_markers

PLACE = Body.at_rest(np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.6, 0.0, 0.8]))


def test_what_a_simulator_is_asked_survives_the_wire() -> None:
    sent = encode_state_change("cup", PLACE)
    name, body = decode_state_change(sent)
    assert name == "cup" and same(body, PLACE)
    sent.state.header.frame_id = "map"
    with rejected("wire.range", "state.header.frame_id"):
        decode_state_change(sent)
    assert decode_simulation_state(encode_state_request(SimState.PAUSED)) == SimState.PAUSED
    for steps in (1, 2**63 - 1):
        assert decode_simulation_steps(encode_steps_goal(steps)) == steps
    assert decode_simulation_steps(StepSimulation.Request(steps=MAX_STEPS)) == MAX_STEPS
    for steps in (0, MAX_STEPS + 1):
        with rejected("wire.range"):
            decode_simulation_steps(StepSimulation.Request(steps=steps))


def test_a_block_to_add_is_named_by_its_uri() -> None:
    asked = SpawnEntity.Request(name="cup", uri="block:red_cube", resource_string="text")
    write_vector(asked.initial_pose.pose.position, PLACE.position)
    write_vector(asked.initial_pose.pose.orientation, PLACE.quaternion, "xyzw")
    spawning = decode_spawning(asked)
    assert (spawning.name, spawning.uri) == ("cup", "block:red_cube") and same(spawning.body, PLACE)
    asked.uri = ""
    assert decode_spawning(asked).uri == "text"


@pytest.mark.parametrize(
    ("kind", "points", "within"),
    [
        (Bounds.TYPE_EMPTY, [], True),
        (Bounds.TYPE_BOX, [(1.0, 1.0, 0.3), (0.1, 0.0, 0.0)], True),  # on two of its faces
        (Bounds.TYPE_BOX, [(1.0, 1.0, 0.2), (0.0, 0.0, 0.0)], False),
        (Bounds.TYPE_SPHERE, [(0.1, 0.2, 0.0), (0.31, 0.0, 0.0)], True),
        (Bounds.TYPE_SPHERE, [(0.1, 0.2, 0.0), (0.29, 0.4, 0.4)], False),
        (Bounds.TYPE_BOX, [(0.0, 0.0, 0.0)], "wire.size"),
        (Bounds.TYPE_CONVEX_HULL, [], "wire.range"),
    ],
)
def test_entities_are_found_within_bounds(kind: int, points: list[Any], within: Any) -> None:
    asked = GetEntities.Request()
    asked.filters.bounds.type = kind
    for place in points:
        asked.filters.bounds.points.append(Vector3(x=place[0], y=place[1], z=place[2]))
    if isinstance(within, str):
        with rejected(within, "filters.bounds"):
            decode_filters(asked)
    else:
        assert decode_filters(asked).within(PLACE) == within


def test_markers_show_each_block_and_its_name_and_delete_those_that_are_gone() -> None:
    solid = Solid("cup", "box", np.array([0.1, 0.1, 0.2]), (1.0, 0.5, 0.0, 0.8), PLACE)
    block, label, *gone = encode_markers([solid], 5, shown=2).markers
    assert [(one.ns, one.id) for one in (block, label)] == [("blocks", 0), ("labels", 0)]
    assert (block.type, block.scale.z, label.text) == (Marker.CUBE, 0.2, "cup")
    assert (block.pose.position.z, label.pose.position.z) == (0.3, pytest.approx(0.37))
    seen = [[c.r, c.g, c.b, c.a] for c in (block.color, label.color)]
    assert seen == [pytest.approx([1.0, 0.5, 0.0, 0.8]), [1.0] * 4]
    left = [(one.ns, one.id, one.action) for one in gone]
    assert left == [("blocks", 1, Marker.DELETE), ("labels", 1, Marker.DELETE)]
