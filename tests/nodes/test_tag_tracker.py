"""The example that finds AprilTags: poses through any lens, and one line for what it cannot use."""

from pathlib import Path

import numpy as np
import pytest

from helpers.graph import graph
from pa_ros.core.extensions import load
from pa_ros.ros import topics
from pa_ros.wire.views import encode_camera_info, encode_image

cv2 = pytest.importorskip("cv2", reason="needs the extra `camera`")
EXAMPLE = Path(__file__).parents[2] / "docs/examples/tag_tracker.py"
SIZE, SIDE, NUMBER = (640, 480), 60, 3  # px
K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
LENSES = {
    "plumb_bob": (-0.3, 0.1, 0.001, -0.001, 0.0),
    "rational_polynomial": (-0.3, 0.1, 0.001, -0.001, 0.0, 0.02, 0.01, 0.0),
    "equidistant": (-0.01, 0.02, -0.01, 0.002),
}


@pytest.fixture(scope="module")
def tracker():
    (example,) = load([str(EXAMPLE)])
    return example


def seen_through(tracker, model, distortion):
    """A picture of a tag near a corner, and where the tag is, [3] m."""
    square = cv2.aruco.generateImageMarker(tracker.DICTIONARY, NUMBER, SIDE)[::-1, ::-1]
    straight, left, top = np.full(SIZE[::-1], 255, np.uint8), 60, 40
    straight[top : top + SIDE, left : left + SIDE] = square
    pixels = np.indices(SIZE[::-1])[::-1].reshape(2, -1).T[:, None].astype(np.float64)
    undistort = (cv2.fisheye if model == "equidistant" else cv2).undistortPoints
    rays = undistort(pixels, K, np.array(distortion), P=K).astype(np.float32)
    u, v = np.moveaxis(rays.reshape(*SIZE[::-1], 2), -1, 0)
    seen = cv2.remap(straight, u, v, cv2.INTER_LINEAR, borderValue=255)
    middle = np.array([left + (SIDE - 1) / 2, top + (SIDE - 1) / 2, 1.0])
    away = 500 * tracker.TAG_M / SIDE
    return seen[..., None].repeat(3, -1), np.linalg.inv(K) @ middle * away


@pytest.mark.parametrize("model", LENSES)
def test_a_tag_is_found_where_it_is_through_any_lens(tracker, model):
    picture, true = seen_through(tracker, model, LENSES[model])
    given = tracker.finder(), picture, K, tracker.TAG_M
    tags = tracker.find(*given, model, LENSES[model]), tracker.find(*given)
    right, without = (np.linalg.norm(found[NUMBER].position - true) for found in tags)
    assert right < 0.006 < 0.03 < without


@pytest.mark.graph
def test_the_tracker_refuses_what_it_cannot_use_and_goes_on(tracker):
    picture, _ = seen_through(tracker, "plumb_bob", ())
    good, small = (encode_image(one, "cam", 5) for one in (picture, picture[::2, ::2]))
    info, wrong = (encode_camera_info(k, *SIZE, "cam", 5) for k in (K, 0 * K))
    with graph(tracker.TagTracker) as probe:
        pictures, infos = map(probe.speaker, (topics.CAMERA_IMAGE, topics.CAMERA_INFO))
        (node,) = probe.nodes
        infos.publish(wrong)
        assert probe.until(lambda: node.refusals.counts["wire.uncalibrated"] == 1)
        pictures.publish(good)
        assert probe.until(lambda: node.refusals.counts["wire.uncalibrated"] == 2)
        infos.publish(info)
        assert probe.until(lambda: node.lens is not None)
        pictures.publish(small)
        assert probe.until(lambda: node.refusals.counts["wire.size"] == 1)
        pictures.publish(good)
        assert probe.until(lambda: probe.count(topics.TF) > 0)
        (found,) = probe.last(topics.TF).transforms
        assert (found.header.frame_id, found.child_frame_id) == ("cam", f"tag36h11:{NUMBER}")
