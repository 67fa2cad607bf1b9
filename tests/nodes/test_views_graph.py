"""What viewers are shown: the URDF, poses, blocks with labels, and how far each is meant."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import graph
from pa_ros.arena.rearranging import bodies
from pa_ros.ros import topics
from pa_ros.wire.program import decode_program_status
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
ARENA = {"sim_node__design": "3-D", "sim_node__seed": 2, "sim_node__program_source": "topic"}
ARENA |= {"sim_node__mode": "real_time"}
TRAINED = {"agent_node__weights": "checkpoint", "agent_node__checkpoint": "shipped:3-D"}


def test_the_description_the_poses_and_the_markers_are_the_arenas():
    with graph(SimNode, **ARENA, sim_node__paused=True) as probe:
        assert probe.until(lambda: probe.count(topics.ROBOT_DESCRIPTION) > 0)
        robot = ET.fromstring(probe.last(topics.ROBOT_DESCRIPTION).data)
        names = [j.get("name") for j in robot.iter("joint") if j.get("type") != "fixed"]
        assert names == list(probe.last(topics.ARENA_INFO).joint_names)
        assert probe.until(lambda: probe.count(topics.TRANSFORMS) >= 5)
        assert probe.until(lambda: probe.count(topics.MARKERS) >= 1)
        known = {m.child_frame_id: m for m in probe.heard["transforms"]}
        markers = probe.last(topics.MARKERS).markers
        blocks = [m for m in markers if m.ns == "blocks"]
        labels = [m.text for m in markers if m.ns == "labels"]
        assert sorted(known) == sorted(["hand", *labels]) and "red_cube" in labels
        for body, name, marker in zip(
            bodies(probe.nodes[0].session.task), ["hand", *labels], [None, *blocks], strict=True
        ):
            place = known[name].transform.translation
            assert [place.x, place.y, place.z] == pytest.approx(body.position.tolist())
            assert known[name].header.frame_id == "world"
            if marker is not None:
                where = marker.pose.position
                assert [where.x, where.y, where.z] == pytest.approx(body.position.tolist())
        cube = blocks[labels.index("red_cube")]
        assert (cube.type, cube.scale.x, cube.scale.z) == (
            1,
            pytest.approx(0.06),
            pytest.approx(0.06),
        )
        assert cube.color.r > 0.5 > cube.color.b
        name, kind = topics.DELETE_ENTITY
        client = probe.create_client(kind, name)
        assert probe.until(client.service_is_ready)
        assert probe.until(client.call_async(kind.Request(entity="red_cube")).done)
        arrays = probe.heard[topics.MARKERS.name]  # the one that deletes need not be the last
        assert probe.until(lambda: any(m.action == 2 for array in arrays for m in array.markers))


def test_the_agent_outlines_what_it_takes_the_program_to_mean():
    with graph(SimNode, AgentNode, **ARENA, **TRAINED) as probe:
        speaker = probe.speaker(topics.PROGRAM)
        program = topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, AND(RED, CUBE))")
        speaker.publish(program)

        def shown() -> list[float]:
            return [m.color.a for m in probe.last(topics.RELEVANCE_MARKERS).markers]

        assert probe.until(lambda: probe.count(topics.RELEVANCE_MARKERS) > 0 and max(shown()) > 0.4)
        assert sorted(shown())[-2] < 0.1  # the one block, and no other
        arena = probe.last(topics.MARKERS).markers
        meant = int(np.argmax(shown()))
        assert [m.text for m in arena if m.ns == "labels"][meant] == "red_cube"
        assert decode_program_status(probe.last(topics.PROGRAM_STATUS)).accepted
