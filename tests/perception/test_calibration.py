"""What blobs look like as numbers, and their tracks: without pictures."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import ArrayLike

from pa_ros.core.settings import canonical_json, read_json

pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
from pa_ros.perception.blobs import CROP_PX, Blob
from pa_ros.perception.calibration import Calibration, Cameras
from pa_ros.perception.errors import PerceptionError
from pa_ros.perception.looks import color, shape
from pa_ros.perception.tracker import Tracker

RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.2, 0.8)


def blob(
    xy: Sequence[float] = (0.0, 0.4),
    rgb: ArrayLike = RED,
    round_: bool = False,
    light: float = 1.0,
    covered: bool = False,
    area: float = 1.0,
) -> Blob:
    """A square or a disk of one color, brighter at the top."""
    v, u = np.mgrid[:CROP_PX, :CROP_PX] - CROP_PX / 2 + 0.5
    inside = (np.hypot(u, v) < 7) if round_ else (np.maximum(abs(u), abs(v)) < 7)
    shading = light * (1 - 0.02 * v)[..., None]
    crop = (inside[..., None] * np.array(rgb) * shading).astype(np.float32)
    mask, box = inside.astype(np.float32), (0, 0, 9, 9)
    return Blob(np.array(xy), crop, mask, area, covered, box, np.ones((10, 10), np.bool_))


@lru_cache
def made_of(seed: int) -> Cameras:
    """Of squares and disks in two colors."""
    rng = np.random.default_rng(seed)
    known = [
        blob(rgb=rng.normal((RED, BLUE)[i % 2], 0.01), round_=i % 4 < 2, area=rng.normal(1, 0.01))
        for i in range(60)
    ]
    return Cameras((Calibration.of("above", (240, 240), known),))


def test_color_does_not_depend_on_light_and_shape_not_on_color() -> None:
    assert np.allclose(color(blob(light=0.5)), color(blob()), atol=2e-3)
    assert np.allclose(shape(blob(rgb=BLUE, light=0.7)), shape(blob()), atol=1e-2)
    assert np.abs(color(blob(rgb=BLUE)) - color(blob())).max() > 0.3
    assert np.abs(shape(blob(round_=True)) - shape(blob())).max() > 0.3


def test_a_calibration_survives_as_text_and_changes_its_digest_with_its_numbers() -> None:
    made = made_of(0)
    again = Cameras.from_text(made.to_text())
    other = made_of(1)
    assert again.digest == made.digest != other.digest
    for one in (blob(), blob(rgb=(0.1, 0.9, 0.1), round_=True)):
        assert (again.features({0: one}) == made.features({0: one})).all()
    channel = made.each[0].channels["color"]
    assert made.features({0: blob()}).any() and not channel(color(blob(rgb=(0, 1, 0)))).any()


def test_a_part_of_an_object_tells_its_color_and_not_its_shape() -> None:
    made, known = made_of(0), blob(round_=True)
    width = made.widths["shape"]
    whole, part = (made.features({0: replace(known, covered=hidden)}) for hidden in (False, True))
    assert whole[:width].any() and not part[:width].any()
    assert (whole[width:] == part[width:]).all()


@pytest.mark.parametrize(
    "damage",
    [{"format": 0}, {"channels": {}}, {"more": 1}, {"channels": {"shape": {}, "color": {}}}],
)
def test_a_damaged_calibration_is_rejected(damage: dict[str, object]) -> None:
    made = made_of(0)
    text = canonical_json({**read_json(made.to_text()), **damage})
    with pytest.raises(PerceptionError, match="calibration: expected what a training run wrote"):
        Cameras.from_text(text)


def test_features_of_two_cameras_stand_beside_each_other_and_one_may_have_seen_nothing() -> None:
    first, second = made_of(0), made_of(1)
    both = Cameras.from_text(Cameras(first.each + second.each).to_text())
    look = blob()
    seen = both.features({0: look, 1: look}) * 2**0.5
    (one,), (other,) = first.each, second.each
    shapes = [camera.channels["shape"](shape(look)) for camera in (one, other)]
    assert np.allclose(seen[: both.widths["shape"]], np.concatenate(shapes))
    half = both.features({1: look}) * 2**0.5
    assert not half[: one.channels["shape"].width].any()
    assert np.allclose(half[one.channels["shape"].width : both.widths["shape"]], shapes[1])


def test_too_few_blobs_make_no_calibration() -> None:
    with pytest.raises(PerceptionError, match="expected at least 40 blobs, found 3: does camera"):
        Calibration.of("above", (240, 240), [blob()] * 3)


def test_a_track_keeps_its_row_place_and_looks_while_its_object_is_covered() -> None:
    tracker = Tracker(most=2)
    tracker.update([blob((0.3, 0.0)), blob((0.0, 0.3), BLUE)])
    tracker.update([blob((0.31, 0.02), covered=True, area=0.3)])
    (first, second) = tracker.tracks
    assert first.xy.tolist() == [0.3, 0.0] and first.looks[0].area == 1.0 and first.age == 0
    assert second.xy.tolist() == [0.0, 0.3] and second.age == 1
    second.looks[0] = replace(second.looks[0], covered=True)  # the other camera sees more
    other = replace(blob((0.02, 0.31), BLUE), camera=1)
    tracker.update([other, replace(blob((0.3, 0.001)), camera=1), blob((0.3, 0.0))])
    assert second.xy.tolist() == [0.02, 0.31] and set(second.looks) == {0, 1}
    assert first.xy.tolist() == [0.3, 0.0] and len(tracker.tracks) == 2
    tracker.update([blob((0.33, 0.0)), blob((0.0, -0.5))])  # pushed, and one without a row
    assert tracker.tracks[0].xy.tolist() == [0.33, 0.0]
    assert len(tracker.tracks) == 2
