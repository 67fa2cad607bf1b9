"""The arena's camera as others see it: off, refused, and pictures in which blocks are found."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from helpers.graph import graph
from helpers.pictures import opengl, pixel_of
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from sim_node.node import SimNode
from sim_node.viewers import CAMERA_FRAME

ARENA = {"sim_node__design": "3-D", "sim_node__seed": 2, "sim_node__program_source": "topic"}
ARENA |= {"sim_node__mode": "real_time"}
ABOVE = {"sim_node__camera.rate_hz": 10.0, "sim_node__camera.view": "above"}
PAIR = topics.CAMERA_IMAGE, topics.CAMERA_INFO


def place_of(transform) -> list[float]:
    where = transform.transform.translation
    return [where.x, where.y, where.z]


@pytest.mark.graph
def test_blocks_are_found_in_the_picture_by_camera_info_and_transforms():
    opengl()
    with graph(SimNode, **ARENA, **ABOVE) as probe:
        markers = topics.MARKERS
        assert probe.until(lambda: probe.count(markers) > 0 and probe.count(PAIR[1]) > 2)
        known = {}

        def posed() -> bool:
            known.update({m.child_frame_id: m for m in probe.heard["transforms"]})
            return CAMERA_FRAME in known and "red_cube" in known

        assert probe.until(posed)
        image, info = (probe.last(topic) for topic in PAIR)
        assert (image.encoding, image.step, len(image.data)) == ("rgb8", 960, 960 * 240)
        assert image.header.frame_id == info.header.frame_id == CAMERA_FRAME
        assert (info.width, info.height) == (image.width, image.height) == (320, 240)
        assert (info.distortion_model, list(info.d)) == ("plumb_bob", [0.0] * 5)
        np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], info.k.reshape(3, 3))
        turn = known[CAMERA_FRAME].transform.rotation
        eye = np.array(place_of(known[CAMERA_FRAME])), [turn.x, turn.y, turn.z, turn.w]
        picture = np.frombuffer(image.data, np.uint8).reshape(240, 320, 3)
        blocks = [m for m in probe.last(markers).markers if m.ns == "blocks"]
        names = [m.text for m in probe.last(markers).markers if m.ns == "labels"]
        assert len(blocks) == 4
        for name, block in zip(names, blocks, strict=True):
            u, v = pixel_of(place_of(known[name]), info.k, *eye)
            seen, paint = picture[round(v), round(u)], block.color
            wanted = [paint.r, paint.g, paint.b]
            assert np.argmax(seen) == np.argmax(wanted) and seen.max() > 1.5 * np.median(seen), name
        stamps = [header_stamp(m) for m in probe.heard[topics.CAMERA_IMAGE.name]]
        assert stamps == sorted(stamps)
        assert probe.until(lambda: int(probe.value("sim_node", "camera.pictures") or 0) > 2)


@pytest.mark.graph
def test_without_being_asked_for_there_is_no_camera():
    with graph(SimNode, **ARENA) as probe:
        names = {publisher.topic_name for publisher in probe.nodes[0].publishers}
        assert not names & {f"/{topic.name}" for topic in PAIR}
        assert probe.until(lambda: probe.count(topics.TRANSFORMS) >= 5)
        assert CAMERA_FRAME not in {m.child_frame_id for m in probe.heard["transforms"]}


@pytest.mark.graph
@pytest.mark.parametrize("name", ["bogus", "off"])
def test_where_there_is_no_opengl_it_is_refused_in_one_line(name):
    asked = [sys.executable, "-m", "sim_node.main", "--ros-args", "-p", "camera.rate_hz:=10.0"]
    ended = subprocess.run(
        asked, env={**os.environ, "MUJOCO_GL": name}, capture_output=True, text=True, timeout=120
    )
    assert ended.returncode == 2
    said = ended.stderr.strip().splitlines()
    assert len(said) == 1 and said[0].startswith("sim_node: [") and "expected" in said[0]
    assert "OpenGL" in said[0] and "MUJOCO_GL" in said[0]
