"""Films with captions: endless WebP in full color, endless GIF, or MP4 if PyAV is installed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pa_ros.arena.errors import RenderError
from pa_ros.core.errors import ConfigError, needs_extra
from pa_ros.core.files import written_beside

Picture = NDArray[np.uint8]
FORMATS = (".webp", ".gif", ".mp4")
WEBP_QUALITY = 80
LINES, PAD_PX = 2, 6


def check_movie(path: Path) -> None:
    """Raise ConfigError for an unknown kind of file, or if MP4 lacks its extra."""
    kind = path.suffix.lower()
    if kind not in FORMATS:
        names = ", ".join(FORMATS)
        raise ConfigError(f"film: {path}: expected a file name that ends in {names}, got {kind!r}")
    if kind == ".mp4":
        _av(path)


def captioned(picture: Picture, lines: Sequence[str], color: str = "black") -> Picture:
    """Write up to LINES lines below a picture [H, W, 3]; the result is [H + text, W, 3].

    The first line is bold, the last one has the `color`. Lines are cut to the width.
    """
    height, width = picture.shape[:2]
    size = max(8, width // 34)
    line_px = round(1.4 * size)
    page = Image.new("RGB", (width, height + LINES * line_px + 2 * PAD_PX), "white")
    page.paste(Image.fromarray(picture), (0, 0))
    draw = ImageDraw.Draw(page)
    for i, line in enumerate(lines[:LINES]):
        font = _font("DejaVuSans" if i else "DejaVuSans-Bold", size)
        while line and draw.textlength(line, font) > width - 2 * PAD_PX:
            line = line.removesuffix("…")[:-1] + "…" if len(line) > 1 else ""
        fill = color if i == len(lines) - 1 else "black"
        draw.text((PAD_PX, height + PAD_PX + i * line_px), line, fill, font)
    return np.asarray(page)


def write_movie(path: Path, pictures: Iterable[Picture], period_s: float) -> int:
    """Write pictures of one size, each shown for `period_s`; returns their number.

    Check the file name first (`check_movie`).

    Raises RenderError if the file cannot be written. An existing file stays until the new one is
    complete.
    """
    kind = path.suffix.lower()
    count = 0

    def counted() -> Iterator[Picture]:
        nonlocal count
        for picture in pictures:
            count += 1
            yield picture

    try:
        with written_beside(path) as beside:
            if kind == ".mp4":
                _write_mp4(beside, counted(), period_s)
            else:
                _write_image(beside, counted(), period_s, kind.removeprefix("."))
    except OSError as error:
        raise RenderError(f"film: {path}: {error}") from error
    return count


def _write_image(path: Path, pictures: Iterator[Picture], period_s: float, kind: str) -> None:
    images = map(Image.fromarray, pictures)
    with path.open("wb") as file:
        next(images).save(
            file, format=kind, save_all=True, append_images=images, loop=0,
            duration=round(1000 * period_s), quality=WEBP_QUALITY, method=4,
        )  # fmt: skip


def _write_mp4(path: Path, pictures: Iterator[Picture], period_s: float) -> None:
    """Write H.264 with a color format that every player supports."""
    av = _av(path)
    opening = _even(next(pictures))
    with av.open(str(path), "w") as film:
        rate = Fraction(1.0 / period_s).limit_denominator(1000)
        stream = film.add_stream("libx264", rate=rate)
        stream.height, stream.width = opening.shape[:2]
        stream.pix_fmt = "yuv420p"
        for picture in chain([opening], map(_even, pictures)):
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        film.mux(stream.encode())


def _even(picture: Picture) -> Picture:
    """The picture with even sides, which the color format needs."""
    rows, columns = (side % 2 for side in picture.shape[:2])
    return np.pad(picture, ((0, rows), (0, columns), (0, 0)), mode="edge")


def _av(path: Path):  # type: ignore[no-untyped-def]  # a library without types
    with needs_extra("film", f"film: {path} (a .webp needs no extra)"):
        import av
    return av


@lru_cache
def _font(name: str, size: int) -> ImageFont.FreeTypeFont:
    from matplotlib import get_data_path

    return ImageFont.truetype(Path(get_data_path()) / f"fonts/ttf/{name}.ttf", size)
