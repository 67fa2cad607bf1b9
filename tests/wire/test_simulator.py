"""The standard services of a simulator: what is asked survives the wire, or is rejected."""

from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from simulation_interfaces.msg import Bounds, EntityFilters
from simulation_interfaces.srv import GetEntities, StepSimulation

from helpers.messages import same
from helpers.rejections import rejected
from pa_ros.core.experience import Body
from pa_ros.wire.simulator import (
    MAX_STEPS,
    decode_filters,
    decode_simulation_steps,
    decode_state_change,
    encode_state_change,
    encode_steps_goal,
)

PLACE = Body.at_rest(np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.6, 0.0, 0.8]))


def test_places_and_steps_survive_the_wire() -> None:
    name, body = decode_state_change(encode_state_change("cup", PLACE))
    assert name == "cup" and same(body, PLACE)
    assert decode_simulation_steps(encode_steps_goal(2**63 - 1)) == 2**63 - 1
    assert decode_simulation_steps(StepSimulation.Request(steps=MAX_STEPS)) == MAX_STEPS
    for steps in (0, MAX_STEPS + 1):
        with rejected("wire.range"):
            decode_simulation_steps(StepSimulation.Request(steps=steps))


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
    bounds = Bounds(type=kind, points=[Vector3(x=x, y=y, z=z) for x, y, z in points])
    asked = GetEntities.Request(filters=EntityFilters(bounds=bounds))
    if isinstance(within, str):
        with rejected(within, "filters.bounds"):
            decode_filters(asked)
    else:
        assert decode_filters(asked).within(PLACE) == within
