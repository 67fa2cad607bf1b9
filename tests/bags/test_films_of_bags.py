"""Films of bags: what was recorded is what is shown and told."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image, ImageSequence

from helpers.pictures import captions
from helpers.recordings import STEPS, acted
from pa_ros.arena.movie import captioned
from pa_ros.arena.render import top_view
from pa_ros.bags.episodes import episodes
from pa_ros.bags.experience import arenas_of
from pa_ros.bags.film import Stage
from pa_ros.bags.reader import Bag
from pa_ros.cli.main import main
from pa_ros.core.signals import EXIT_INTERRUPTED
from pa_ros.world.schema import PAPER

pytestmark = pytest.mark.xdist_group("looking into bags")  # their recordings are made once


def test_the_stage_shows_what_was_recorded(stepped, learned, changing):
    """The features of the scene put up again are those recorded: blocks and hand are in place."""
    for path, tolerance, every in ((stepped, 1e-5, 7), (learned, 1e-5, 7), (changing, 1e-5, 1)):
        with Bag(path) as bag:
            episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
        stage = Stage(episode, arena)
        for row in episode.rows[::every]:
            stage.show(row)
            given = stage.task.simulation.objects()
            np.testing.assert_allclose(given[:, :3], row.objects[:, :3], atol=tolerance)
            turned = np.abs(np.sum(given[:, 3:7] * row.objects[:, 3:7], axis=1))
            np.testing.assert_allclose(turned, 1.0, atol=tolerance)
            np.testing.assert_array_equal(given[:, 7:], row.objects[:, 7:])


def test_a_film_has_a_picture_of_each_step_at_the_arenas_speed(stepped, tmp_path, capsys):
    out = tmp_path / "film.gif"
    arguments = ["--episode", "7", "--evaluation", "--side", "96", "--out", str(out)]
    assert main(["bag", "film", str(stepped), *arguments]) == 0
    with Image.open(out) as film:
        assert film.format == "GIF" and film.size == (96, 126)  # with its caption
        assert film.info["duration"] == 100
        pictures = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(film)]
    shown = len(pictures)
    assert (pictures[-1] != pictures[0]).any()
    assert STEPS // 2 < shown <= STEPS + 1  # equal pictures in a row are stored once
    assert main(["bag", "film", str(stepped), "--episode", "8", "--out", str(out)]) == 2
    assert "expected an episode of 7 to 7, got 8" in capsys.readouterr().err
    movie = tmp_path / "film.avi"
    assert main(["bag", "film", str(stepped), *arguments[:-1], str(movie)]) == 2
    assert "expected a file that ends in .gif or .mp4, got '.avi'" in capsys.readouterr().err
    assert not movie.exists()


def test_a_film_goes_on_where_blocks_come_and_go(changing, tmp_path, capsys):
    out = str(tmp_path / "film.gif")
    assert main(["bag", "film", str(changing), "--episode", "7", "--side", "64", "--out", out]) == 0
    assert "9 pictures" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", "a-program-id", "NEAR(HAND, AND(CYLINDER, CAPSULE))"])
def test_a_film_shows_no_target_where_none_is_known(stepped, text):
    """Before the first program, and where it is gone or names nothing."""
    with Bag(stepped) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    known = episode.rows[4]
    for row in episode.rows[:4] + episode.rows[5:]:
        row.program = text
    stage, targets = Stage(episode, arena), []
    for row in episode.rows[:9]:
        stage.show(row)
        targets.append(len(stage.task.verifier.targets))
        top_view(stage.task, 64)
    assert known.program and targets == [0] * 4 + [1] + [0] * 4


def test_a_film_needs_no_block_that_has_a_word(stepped):
    with Bag(stepped) as bag:
        episode, arena = next(iter(episodes(bag))), arenas_of(bag)[-1]
    spare = list(PAPER.features({"shape": "CAPSULE", "color": "MAGENTA"})[7:])
    for row in episode.rows:
        row.objects[1:, 7:] = spare
    stage = Stage(episode, arena)
    stage.show(episode.rows[0])
    assert stage.task.verifier.targets == ()


def test_a_film_tells_the_program_the_step_and_the_reward(stepped, tmp_path, monkeypatch):
    said = captions(monkeypatch, "pa_ros.bags.film.captioned")
    out = str(tmp_path / "film.gif")
    arguments = ["--episode", "7", "--side", "64", "--out", out]
    assert main(["bag", "film", str(stepped), *arguments]) == 0
    steps = acted()[: STEPS + 1]
    for (program, state), (_, verdict, _, asked, _) in zip(said, steps, strict=True):
        assert program == str(asked) and f"distance {verdict.distance:.2f} m" in state
    assert said[0][1].startswith("step 0") and f"step {STEPS}   reward" in said[-1][1]


def test_a_film_that_is_interrupted_leaves_the_one_before(stepped, tmp_path, monkeypatch):
    out = tmp_path / "films" / "film.gif"
    arguments = ["bag", "film", str(stepped), "--episode", "7", "--side", "64", "--out", str(out)]
    assert main(arguments) == 0
    before, shown = out.read_bytes(), []

    def interrupted(*given):
        if len(shown) == 3:
            raise KeyboardInterrupt
        shown.append(given)
        return captioned(*given)

    monkeypatch.setattr("pa_ros.bags.film.captioned", interrupted)
    assert main(arguments) == EXIT_INTERRUPTED
    assert out.read_bytes() == before and [*out.parent.iterdir()] == [out]
