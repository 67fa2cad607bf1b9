"""Pictures in a row with a caption: an endless GIF, or MP4 where PyAV is installed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pa_ros.arena.appearance import COLOR_RGBA
from pa_ros.arena.errors import RenderError
from pa_ros.core.errors import ConfigError
from pa_ros.core.files import written_beside

Picture = NDArray[np.uint8]
FORMATS = (".gif", ".mp4")
COLORS = 96  # of a GIF's palette
SHADES = (0.35, 0.6, 0.8, 1.0)  # of a color, in light and shadow
LINES, PAD_PX = 2, 4


def check_movie(path: Path) -> None:
    """ConfigError unless the file's name says what is written, and what that takes is there."""
    kind = path.suffix.lower()
    if kind not in FORMATS:
        names = " or ".join(FORMATS)
        raise ConfigError(f"film: {path}: expected a file that ends in {names}, got {kind!r}")
    if kind == ".mp4":
        _av(path)


def captioned(picture: Picture, lines: Sequence[str]) -> Picture:
    """[H, W, 3] with up to LINES lines of text below, each cut to the width: [H + text, W, 3]."""
    height, width = picture.shape[:2]
    font = _font(max(8, width // 36))
    line_px = round(1.3 * font.size) + 1
    page = Image.new("RGB", (width, height + LINES * line_px + 2 * PAD_PX), "white")
    page.paste(Image.fromarray(picture), (0, 0))
    draw = ImageDraw.Draw(page)
    for i, line in enumerate(lines[:LINES]):
        while line and draw.textlength(line, font) > width - 2 * PAD_PX:
            line = line.removesuffix("…")[:-1] + "…" if len(line) > 1 else ""
        draw.text((PAD_PX, height + PAD_PX + i * line_px), line, "black", font)
    return np.asarray(page)


def write_movie(path: Path, pictures: Iterable[Picture], period_s: float) -> int:
    """Write pictures of one size, `period_s` each; how many. RenderError if the file can't be.

    Until all are there the file, if there was one, is as it was.
    """
    check_movie(path)
    write = _write_mp4 if path.suffix.lower() == ".mp4" else _write_gif
    count = 0

    def counted() -> Iterator[Picture]:
        nonlocal count
        for picture in pictures:
            count += 1
            yield picture

    try:
        with written_beside(path) as beside:
            write(beside, counted(), period_s)
    except OSError as error:
        raise RenderError(f"film: {path}: {error}") from error
    return count


def _write_gif(path: Path, pictures: Iterator[Picture], period_s: float) -> None:
    """One palette for all pictures, so that what stands still costs nothing."""
    opening = next(pictures)
    palette = _palette(opening)
    reduced = (
        Image.fromarray(one).quantize(palette=palette, dither=Image.Dither.NONE)
        for one in chain([opening], pictures)
    )
    with path.open("wb") as file:
        next(reduced).save(
            file, format="GIF", save_all=True, append_images=reduced, loop=0, optimize=True,
            duration=round(1000 * period_s),
        )  # fmt: skip


def _palette(opening: Picture) -> Image.Image:
    """The first picture's colors, and shades of every block's that may come."""
    looks = [[float(part) for part in rgba.split()[:3]] for rgba in COLOR_RGBA.values()]
    shades = 255 * np.multiply.outer(SHADES, np.array(looks)).reshape(-1, 3)
    rows = len(opening) // 2  # so that they count beside the table
    strip = np.resize(shades.astype(np.uint8), (rows, opening.shape[1], 3))
    both = Image.fromarray(np.concatenate([opening, strip]))
    return both.quantize(COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def _write_mp4(path: Path, pictures: Iterator[Picture], period_s: float) -> None:
    """H.264 with colors that every player knows."""
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
    """Sides that are even, as MP4's colors want them: a row or column more."""
    rows, columns = (side % 2 for side in picture.shape[:2])
    return np.pad(picture, ((0, rows), (0, columns), (0, 0)), mode="edge")


def _av(path: Path):  # type: ignore[no-untyped-def]  # not there without the extra
    try:
        import av
    except ImportError as error:
        raise ConfigError(
            f"film: {path}: expected the extra film (`make install-film`, or pip install "
            f'"programmable-agents[film]"), got: {error}; a .gif needs nothing'
        ) from error
    return av


def _font(size: int) -> ImageFont.FreeTypeFont:
    from matplotlib import get_data_path

    return ImageFont.truetype(Path(get_data_path()) / "fonts/ttf/DejaVuSans.ttf", size)
