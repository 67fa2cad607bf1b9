"""What viewers show: the URDF, poses, blocks with labels, how far each is meant, a camera."""

from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from agent_node.node import AgentNode
from helpers.graph import SCENE, TRAINED, Probe, graph
from helpers.pictures import opengl, pixel_of
from pa_ros.arena.rearranging import bodies
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.views import OPTICAL_FRAME as CAMERA_FRAME
from sim_node.node import SimNode

pytestmark = pytest.mark.graph
CAMERA = {
    "sim_node__program_source": "topic",
    "sim_node__camera.rate_hz": 10.0,
    "sim_node__camera.view": "above",
}


@pytest.fixture(scope="module")
def probe(module_domain: str) -> Iterator[Probe]:
    """One arena with a camera, and a trained agent, for all tests of this module."""
    opengl()
    with graph(SimNode, AgentNode, **SCENE, **TRAINED, **CAMERA) as probe:
        assert probe.until(lambda: probe.count(topics.TF) >= 2)
        assert probe.until(lambda: probe.count(topics.MARKERS) >= 1)
        yield probe


def poses(probe: Probe) -> dict[str, Any]:
    """The newest transform of each frame."""
    messages = [*probe.heard["tf_static"], *probe.heard["tf"]]
    return {one.child_frame_id: one for message in messages for one in message.transforms}


def blocks_and_names(probe: Probe) -> tuple[list[Any], list[str]]:
    """Of the arena's newest markers; the agent publishes on the same topic."""
    arrays = [array.markers for array in probe.heard[topics.MARKERS.name]]
    newest = [markers for markers in arrays if any(m.ns == "labels" for m in markers)][-1]
    blocks = [m for m in newest if m.ns == "blocks"]
    return blocks, [m.text for m in newest if m.ns == "labels"]


def place_of(transform: Any) -> list[float]:
    where = transform.transform.translation
    return [where.x, where.y, where.z]


def test_blocks_are_found_in_the_picture_by_camera_info_and_transforms(probe):
    assert probe.until(lambda: probe.count(topics.CAMERA_INFO) > 2 and CAMERA_FRAME in poses(probe))
    image, info = probe.last(topics.CAMERA_IMAGE), probe.last(topics.CAMERA_INFO)
    assert (image.encoding, image.step, len(image.data)) == ("rgb8", 960, 960 * 240)
    assert image.header.frame_id == info.header.frame_id == CAMERA_FRAME
    assert (info.width, info.height) == (image.width, image.height) == (320, 240)
    assert (info.distortion_model, list(info.d)) == ("plumb_bob", [0.0] * 5)
    np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], info.k.reshape(3, 3))
    known = poses(probe)
    turn = known[CAMERA_FRAME].transform.rotation
    eye = np.array(place_of(known[CAMERA_FRAME])), [turn.x, turn.y, turn.z, turn.w]
    picture = np.frombuffer(image.data, np.uint8).reshape(240, 320, 3)
    blocks, names = blocks_and_names(probe)
    assert len(blocks) == 4
    for name, block in zip(names, blocks, strict=True):
        u, v = pixel_of(place_of(known[name]), info.k, *eye)
        seen, paint = picture[round(v), round(u)], block.color
        wanted = [paint.r, paint.g, paint.b]
        assert np.argmax(seen) == np.argmax(wanted) and seen.max() > 1.5 * np.median(seen), name
    stamps = [header_stamp(m) for m in probe.heard[topics.CAMERA_IMAGE.name]]
    assert stamps == sorted(stamps)


def test_the_agent_outlines_what_it_takes_the_program_to_mean(probe):
    program = topics.PROGRAM.type(program_id="mine", text="NEAR(HAND, AND(RED, CUBE))")
    probe.speaker(topics.PROGRAM).publish(program)

    def opacities() -> list[float]:
        markers = [m for array in probe.heard[topics.MARKERS.name] for m in array.markers]
        newest = {m.id: m.color.a for m in markers if m.ns == "relevance"}
        return [newest[i] for i in sorted(newest)]

    assert probe.until(lambda: max(opacities(), default=0.0) > 0.4)
    assert sorted(opacities())[-2] < 0.1  # one block, and no other
    _, names = blocks_and_names(probe)
    assert names[int(np.argmax(opacities()))] == "red_cube"


def test_the_description_the_poses_and_the_markers_are_the_arenas(probe):
    assert probe.pause().success
    robot = ET.fromstring(probe.last(topics.ROBOT_DESCRIPTION).data)
    names = [j.get("name") for j in robot.iter("joint") if j.get("type") != "fixed"]
    assert names == list(probe.last(topics.ARENA_INFO).joint_names)
    seen = probe.count(topics.MARKERS)
    assert probe.until(lambda: probe.count(topics.MARKERS) > seen + 1)
    known, (blocks, labels) = poses(probe), blocks_and_names(probe)
    assert sorted(known) == sorted(["base", "hand", CAMERA_FRAME, *labels]) and "red_cube" in labels
    hand, *placed = bodies(probe.nodes[0].session.task)
    assert place_of(known["hand"]) == pytest.approx(hand.position.tolist())
    for body, name, marker in zip(placed, labels, blocks, strict=True):
        where = marker.pose.position
        assert [where.x, where.y, where.z] == pytest.approx(body.position.tolist())
        assert place_of(known[name]) == pytest.approx(body.position.tolist())
    cube = blocks[labels.index("red_cube")]
    assert (cube.type, cube.scale.x, cube.scale.z) == (1, pytest.approx(0.06), pytest.approx(0.06))
    assert cube.color.r > 0.5 > cube.color.b


def test_the_marker_of_a_deleted_block_is_deleted(probe):
    name, kind = topics.DELETE_ENTITY
    client = probe.create_client(kind, name)
    assert probe.until(client.service_is_ready)
    assert probe.until(client.call_async(kind.Request(entity="red_cube")).done)
    arrays = probe.heard[topics.MARKERS.name]
    assert probe.until(lambda: any(m.action == 2 for array in arrays for m in array.markers))
