"""The look of a blob as numbers: its color apart from its shape.

Color is the mean chromaticity, which brightness does not change. Shape is the relative brightness,
the outline and the area. Detectors are linear, and words must hold for colors and shapes
that were not seen together, so the two must not be mixed.
"""

from __future__ import annotations

import cv2
import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.blobs import Blob

GRID = 12  # a shape's pixels, each side
LITTLE = 1e-3  # added to what is divided by


def color(blob: Blob) -> Float64:
    """Shares of red, green and blue, [3]."""
    inside = blob.crop[blob.mask > 0.5]
    mean = inside.mean(0).astype(np.float64) if len(inside) else np.zeros(3)
    return np.asarray(mean / (mean.sum() + LITTLE))


def shape(blob: Blob) -> Float64:
    """Relative brightness [GRID²], outline [GRID²] and area [1]."""
    bright = blob.crop.max(-1)
    inside = blob.mask > 0.5
    bright = bright / (bright[inside].mean() + LITTLE) if inside.any() else bright
    return np.concatenate([_small(bright), _small(blob.mask), [blob.area]]).astype(np.float64)


CHANNELS = {"shape": shape, "color": color}
"""The measurement for each property group."""
NEEDS_ALL = ("shape",)  # groups that are measured only where the whole object is seen


def _small(image: Float32) -> Float32:
    small = cv2.resize(image, (GRID, GRID), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32).ravel()
