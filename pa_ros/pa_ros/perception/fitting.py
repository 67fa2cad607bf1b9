"""The position of a block that the arm hides, in part or fully, while it pushes the block.

The outline from the block's last whole picture is moved over the new picture until it explains best
which pixels show the block and which show the table. Pixels of the arm count for neither.
"""

from __future__ import annotations

import cv2
import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.blobs import Blob
from pa_ros.perception.view import BLOCK_M, PLANE_M, Mask, View

FARTHEST_M = 0.06  # a block moves at most so far between two pictures
NEARER = 0.01  # pixels by which a farther position must explain more, per square pixel of distance


def fitted(
    view: View, uncovered: Mask, last: Float64, whole: Blob | None, part: Blob | None
) -> Float64:
    """The position [2], m, of a block that was at `last`.

    :param uncovered: the pixels that the arm does not cover.
    :param whole: the last blob that showed all of the block; None: any block.
    :param part: what is seen of it now; None: nothing.
    """
    scale = view.pixels_per_m(last)
    side, far = round(BLOCK_M * scale), int(np.ceil(FARTHEST_M * scale))
    outline = np.ones((side, side), np.bool_) if whole is None else whole.pixels
    height, width = outline.shape
    # The middle of the outline, from its upper left corner, and that corner at the place before.
    v, u = np.argwhere(outline).mean(0)
    column, row = view.pixels(last, PLANE_M)
    left, top = int(np.rint(column - u)), int(np.rint(row - v))
    window = left - far, top - far, width + 2 * far, height + 2 * far
    free, shown = _cut(uncovered, window), np.zeros_like(uncovered)
    if part is not None:
        x, y = part.box[:2]
        shown[y : y + len(part.pixels), x : x + part.pixels.shape[1]] = part.pixels
    # Free pixels of the outline at each place, less those that show the block.
    wrong = cv2.matchTemplate(
        free - 2 * _cut(shown, window), outline.astype(np.float32), cv2.TM_CCORR
    )
    y, x = np.mgrid[-far : far + 1, -far : far + 1]
    best = np.unravel_index(np.argmin(wrong + NEARER * (x**2 + y**2)), wrong.shape)
    down, right = int(best[0]) - far, int(best[1]) - far
    visible = outline & (free[best[0] :, best[1] :][:height, :width] > 0)
    if part is None or not visible.any():
        there = view.on_plane(column + right, row + down, PLANE_M)
        moved: Float64 = last + there - view.on_plane(column, row, PLANE_M)
        return moved
    # To a fraction of a pixel: as far from the middle of what is seen as in the outline.
    v, u = np.argwhere(outline).mean(0) - np.argwhere(visible).mean(0)
    seen_v, seen_u = np.argwhere(part.pixels).mean(0)
    return view.on_plane(part.box[0] + seen_u + u, part.box[1] + seen_v + v, PLANE_M)


def _cut(mask: Mask, window: tuple[int, int, int, int]) -> Float32:
    """A window (left, top, width, height) of a mask; 0 outside of it."""
    left, top, width, height = window
    margin = max(width, height)
    left, top = (np.clip([left, top], -margin, np.array(mask.shape[::-1])) + margin).tolist()
    padded = np.pad(mask, margin)
    return padded[top : top + height, left : left + width].astype(np.float32)
