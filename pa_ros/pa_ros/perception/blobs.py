"""Parts of a picture that may be objects, because the empty table looks different there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.errors import PerceptionError
from pa_ros.perception.view import BLOCK_M, PLANE_M, Mask, Picture, View, largest, total

UNLIKE_TABLE = 30  # least difference of a color, 0 to 255
SHADE, DARKEST = 12, 0.3  # greatest difference of a color in a shadow, and a shadow's least light
# A camera's picture beyond these is refused. 15 blocks hide 0.07 of the table, seen from a corner.
LEAST_LIGHT = 0.4  # of the light in which the table is known
MOST_HIDDEN, MOST_BLOBS = 0.15, 60  # share of the table; about 40 blocks
SMALLEST, LARGEST = 0.12, 1.75  # of a block's area: less is noise, more is several blocks
CROP_M, CROP_PX = 0.10, 24  # of the square that is cut out around a blob
COLORFUL = 90  # least saturation of pixels whose hue counts, 0 to 255
HUES, HUES_SHIFT, HUE_WIDTH = 180, 8, 16  # OpenCV's hue is 0 to 179; red is around 0
CORE = 0.7  # of the greatest distance to the edge: the middle of a block
ONES = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Blob:
    """A part of a picture that may be one object."""

    xy: Float64  # [2] m on the table
    crop: Float32  # [CROP_PX, CROP_PX, 3] in [0, 1]; 0 where it is not of the blob
    mask: Float32  # [CROP_PX, CROP_PX] in [0, 1]
    area: float  # in areas of a usual block
    covered: bool  # in part, by the arm or by the picture's edge
    box: tuple[int, int, int, int]  # left, top, right, bottom; px
    pixels: Mask  # [height, width] of the box: those that are of the blob
    camera: int = 0  # that saw it; those with lower numbers are more exact


def uncovered(view: View, arm: Mask) -> Mask:
    """The pixels of the table that the arm does not cover; those at its edge count as covered."""
    covered = cv2.dilate(arm.astype(np.uint8), ONES)
    return np.asarray(view.table & (covered == 0))


def blobs(view: View, picture: Picture, arm: Mask) -> list[Blob]:
    """The blobs in a picture, without what shows the arm.

    PerceptionError, before anything takes long, for a picture that scarcely shows the table.
    """
    table = uncovered(view, arm)
    unlike = _unlike(picture, view.empty, table)
    if (hidden := unlike.sum() / max(table.sum(), 1)) > MOST_HIDDEN:
        raise _refused(f"at most {MOST_HIDDEN:.0%} of it hidden by objects", f"{hidden:.0%}")
    shown = unlike.astype(np.uint8)
    beside_arm = np.asarray(cv2.dilate(arm.astype(np.uint8), ONES, iterations=2) > 0)
    hsv = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV), np.uint8)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(shown, connectivity=8)
    found = []
    for i in range(1, count):
        x, y, w, h, area = map(int, stats[i])
        xy = view.on_plane(middles[i, 0], middles[i, 1], PLANE_M)
        block = (BLOCK_M * view.pixels_per_m(xy)) ** 2  # px
        if area < SMALLEST * block:
            continue
        window = slice(y, y + h), slice(x, x + w)
        whole = labels[window] == i
        parts = _split(whole, hsv[window], block) if area > LARGEST * block else [whole]
        for part in parts:
            if part.sum() >= SMALLEST * block:
                mask = np.zeros(shown.shape, np.bool_)
                mask[window] = part
                found.append(_blob(view, picture, mask, beside_arm))
        _check_count(len(found))
    return found


def _unlike(picture: Picture, empty: NDArray[np.int16], table: Mask) -> Mask:
    """The pixels of the table that do not show it, in any light."""
    light = np.median(total(picture.astype(np.int32))[table] / total(empty.astype(np.int32))[table])
    if light < LEAST_LIGHT:
        raise _refused(f"at least {LEAST_LIGHT:.0%} of its light", f"{light:.0%}")
    expected = np.minimum(empty * light, 255)
    unlike: Mask = table & (largest(np.abs(picture - expected)) > UNLIKE_TABLE)
    # A shadow has the table's color. The mean over some pixels is compared, because of noise.
    seen, known = (cv2.blur(x.astype(np.float32), (3, 3)) for x in (picture, empty))
    shade = total(seen * known) / np.maximum(total(known * known), 1.0)
    other = largest(np.abs(seen - shade[..., None] * known))
    shaded = (unlike & (other < SHADE * light) & (shade > DARKEST * light)).astype(np.uint8)
    # Where nothing casts a shadow, such pixels are the dark edges of objects.
    casts = bool(cv2.morphologyEx(shaded, cv2.MORPH_OPEN, ONES).any())
    return unlike & (shaded == 0) if casts else unlike


def _check_count(count: int) -> None:
    if count > MOST_BLOBS:
        raise _refused(f"at most {MOST_BLOBS} objects on it", "more")


def _refused(expected: str, got: str) -> PerceptionError:
    return PerceptionError(
        f"picture: expected the table as calibrated, {expected}, got {got}: check the camera's "
        "place, light and colors",
        code="perception.picture",
    )


def _blob(view: View, picture: Picture, mask: Mask, beside_arm: Mask) -> Blob:
    v, u = np.nonzero(mask)
    left, top, right, bottom = int(u.min()), int(v.min()), int(u.max()), int(v.max())
    at_edge = left == 0 or top == 0 or right == view.width - 1 or bottom == view.height - 1
    middle = float(u.mean()), float(v.mean())
    xy = view.on_plane(*middle, PLANE_M)
    scale = view.pixels_per_m(xy)
    zoom = CROP_PX / (CROP_M * scale)
    shift = [(CROP_PX - 1) / 2 - zoom * x for x in middle]
    to_crop = np.array([[zoom, 0.0, shift[0]], [0.0, zoom, shift[1]]])
    cut: list[Float32] = [
        np.asarray(cv2.warpAffine(image, to_crop, (CROP_PX, CROP_PX)) / 255, np.float32)
        for image in (picture * mask[..., None], mask.astype(np.uint8) * 255)
    ]
    area = len(u) / (BLOCK_M * scale) ** 2
    covered = at_edge or bool((mask & beside_arm).any())
    pixels = mask[top : bottom + 1, left : right + 1]
    return Blob(xy, cut[0], cut[1], area, covered, (left, top, right, bottom), pixels)


def _split(whole: Mask, hsv: NDArray[np.uint8], block: float) -> Iterator[Mask]:
    """The parts of blocks that touch: by hue, and where the hue is the same, by their middles."""
    colorful = whole & (hsv[..., 1] > COLORFUL)
    hue = (hsv[..., 0].astype(int) + HUES_SHIFT) % HUES // HUE_WIDTH
    of_hue = [colorful & (hue == one) for one in np.unique(hue[colorful])]
    groups = [part for part in of_hue if part.sum() > 0.25 * block] or [whole]
    for group in _nearest(groups, whole):
        if group.sum() <= LARGEST * block:
            yield group
            continue
        inner = cv2.distanceTransform(np.pad(group.astype(np.uint8), 1), cv2.DIST_L2, 5)
        inner = inner[1:-1, 1:-1]
        count, cores = cv2.connectedComponents((inner > CORE * inner.max()).astype(np.uint8))
        _check_count(count - 1)
        yield from _nearest([cores == i for i in range(1, count)], group)


def _nearest(cores: list[Mask], whole: Mask) -> Iterator[Mask]:
    """Each pixel of `whole` goes to the nearest of several cores."""
    away = [cv2.distanceTransform((~core).astype(np.uint8), cv2.DIST_L2, 3) for core in cores]
    nearest = np.argmin(away, 0)
    for i in range(len(cores)):
        yield whole & (nearest == i)
