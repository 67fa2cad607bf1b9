"""Films: the file name chooses the format, pictures have captions, errors are one line."""

import sys

import numpy as np
import pytest
from PIL import Image, ImageSequence

from helpers.pictures import captions
from pa_ros.arena.errors import RenderError
from pa_ros.arena.movie import captioned, check_movie, write_movie
from pa_ros.cli.main import main
from pa_ros.core.errors import ConfigError

RED, GREEN = (217, 38, 38), (38, 166, 51)


def pictures(count, side=65):
    for i in range(count):
        picture = np.full((side, side, 3), 230, dtype=np.uint8)
        picture[i : i + 8, i : i + 8] = RED if i < count // 2 else GREEN
        yield picture


@pytest.mark.parametrize("kind", ["webp", "gif"])
def test_an_image_file_has_every_picture_and_colors_that_appear_later(tmp_path, kind):
    path = tmp_path / f"film.{kind}"
    assert write_movie(path, pictures(6), 0.2) == 6
    with Image.open(path) as film:
        assert film.info["loop"] == 0
        shown = [np.asarray(one.convert("RGB")).astype(int) for one in ImageSequence.Iterator(film)]
        assert film.info["duration"] == 200
    assert len(shown) == 6
    for i, color in ((0, RED), (5, GREEN)):
        assert np.abs(shown[i][i + 4, i + 4] - color).max() < 40


def test_an_mp4_can_be_read_again_even_with_odd_sides(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    assert write_movie(path, pictures(6), 0.1) == 6
    with av.open(str(path)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        assert film.streams.video[0].average_rate == 10
    assert len(frames) == 6 and frames[0].shape == (66, 66, 3)
    assert np.abs(frames[0][4, 4].astype(int) - RED).max() < 60


def test_an_mp4_without_the_extra_is_rejected(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ConfigError, match=r"programmable-agents\[film\]"):
        check_movie(tmp_path / "film.mp4")
    check_movie(tmp_path / "film.gif")


def test_a_caption_is_below_the_picture_and_cut_to_its_width():
    picture = np.zeros((60, 90, 3), dtype=np.uint8)
    short = captioned(picture, ["RED", "step 1"])
    assert (short[:60] == picture).all() and short.shape == (94, 90, 3)
    red = captioned(np.zeros((60, 340, 3), np.uint8), ["RED", "step 1"], "red").astype(int)
    assert red.shape == (60 + 2 * 14 + 12, 340, 3) and (red[60:69] == 255).all()
    assert (red[69:76, :, 0] == red[69:76, :, 1]).all() and (red[83:91, :, 0] == 255).all()
    long = captioned(picture, ["RED" * 50, "step 1"])
    assert long.shape == short.shape and (long[60:, -4:] == 255).all(), "a margin stays"
    assert captioned(picture, ["", ""]).min() == 0 and (captioned(picture, [""])[60:] == 255).all()


def test_a_file_that_cannot_be_written_is_rejected(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RenderError, match="file"):
        write_movie(tmp_path / "file" / "film.webp", pictures(2), 0.1)


def test_the_film_of_the_shipped_agent_shows_that_it_reaches_all_targets(
    tmp_path, capsys, monkeypatch
):
    said = captions(monkeypatch, "pa_ros.tools.film.captioned")
    out = tmp_path / "film.gif"
    assert main(["film", "--out", str(out), "--seed", "0", "--width", "64"]) == 0
    assert capsys.readouterr().out.endswith(f" pictures in {out}; not reached: none\n")
    ends = {program: state for program, state in said}
    assert len(ends) == 6 and all(state.endswith("reached") for state in ends.values())


@pytest.mark.parametrize(
    ("arguments", "refused"),
    [
        (["--out", "x.avi"], "ends in .webp, .gif, .mp4"),
        (["--out", "x.gif", "--width", "9"], "--width: expected an integer in [64, 2000], got 9"),
        (["--out", "x.gif", "--checkpoint", "nowhere"], "nowhere"),
    ],
)
def test_wrong_options_are_rejected_and_write_nothing(
    arguments, refused, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert main(["film", *arguments]) == 2
    error = capsys.readouterr().err
    assert refused in error and error.count("\n") == 1 and not list(tmp_path.iterdir())
