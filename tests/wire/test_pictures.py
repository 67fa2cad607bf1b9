"""Pictures of a camera in any usual encoding, and what is known of its lens."""

from array import array
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from helpers.rejections import rejected
from pa_ros.wire.views import ENCODINGS, decode_camera_info, decode_image

RGB = np.arange(10, 28, dtype=np.uint8).reshape(2, 3, 3)
RGBA = np.pad(RGB, ((0, 0), (0, 0), (0, 1)))
GRAY, GRAY_16 = RGB[..., :1], RGB[..., :1].astype("<u2") * 256 + 99
PIXELS = (RGB, RGB[..., ::-1], RGBA, RGBA[..., [2, 1, 0, 3]], GRAY, GRAY_16)
K = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]


def image(encoding: str, pixels: NDArray[Any], padding: int = 0) -> Image:
    data = np.pad(np.ascontiguousarray(pixels).reshape(2, -1).view("u1"), ((0, 0), (0, padding)))
    message = Image(height=2, width=3, encoding=encoding, step=data.shape[1])
    message.data = array("B", data.tobytes())
    return message


@pytest.mark.parametrize("padding", [0, 5])
def test_a_picture_in_any_usual_encoding_becomes_rgb(padding: int) -> None:
    for encoding, pixels in zip(ENCODINGS, PIXELS, strict=True):
        _, picture = decode_image(image(encoding, pixels, padding))
        expected = GRAY.repeat(3, -1) if encoding.startswith("mono") else RGB
        assert picture.dtype == np.uint8 and picture.tolist() == expected.tolist(), encoding
    swapped = image("mono16", GRAY_16.astype(">u2"), padding)
    swapped.is_bigendian = 1
    assert decode_image(swapped)[1].tolist() == GRAY.repeat(3, -1).tolist()


@pytest.mark.parametrize(
    ("field", "value", "code", "why"),
    [
        ("encoding", "yuv422", "encoding", "one of rgb8, bgr8, rgba8, bgra8, mono8, mono16, rec"),
        ("encoding", "rgba8", "size", "2 rows of 9 bytes, at least 12, received 18"),
        ("data", array("B", bytes(17)), "size", "received 17 bytes"),
        ("height", 0, "size", "expected 0 rows"),
        ("width", 0, "size", "received 18 bytes"),
    ],
)
def test_other_pictures_are_rejected(field: str, value: Any, code: str, why: str) -> None:
    wrong = image("rgb8", RGB)
    setattr(wrong, field, value)
    with rejected(f"wire.{code}", why):
        decode_image(wrong)


@pytest.mark.parametrize(
    ("k", "model", "d", "field"),
    [
        ([0.0] * 9, "plumb_bob", (), "k"),
        ([float("nan"), *K[1:]], "plumb_bob", (), "k"),
        ([0.0, *K[1:]], "plumb_bob", (), "k"),
        ([*K[:4], 0.0, *K[5:]], "plumb_bob", (), "k"),
        (K, "thin_prism", (0.0,) * 4, "d: expected one of plumb_bob, rational_polynomial, equidis"),
        (K, "equidistant", (0.0,) * 5, "d"),
        (K, "plumb_bob", (float("nan"),) * 5, "d"),
    ],
)
def test_a_camera_without_a_usable_calibration_is_rejected(
    k: list[float], model: str, d: tuple[float, ...], field: str
) -> None:
    with rejected("wire.uncalibrated", rf"camera_info\.{field}"):
        decode_camera_info(CameraInfo(distortion_model=model, d=list(d), k=np.array(k)))
    usual = CameraInfo(distortion_model="plumb_bob", d=[0.0] * 5, k=np.array(K), width=640)
    lens = decode_camera_info(usual)
    assert (lens.matrix.ravel().tolist(), lens.size) == (K, (640, 0))
