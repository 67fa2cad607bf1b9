"""Wrong pictures of a camera: they leave no object behind, and take no time."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pa_ros.arena import Block, ReachTask, design_named, preset_named, scripted_action
from pa_ros.core.experience import Float32
from pa_ros.perception import sight_of

pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
import cv2

from pa_ros.perception.calibration import Cameras
from pa_ros.perception.sight import Sight
from pa_ros.perception.tracker import LOST, SIGHTINGS
from pa_ros.perception.view import Picture

CONFIG, DESIGN = preset_named("fast"), design_named("3-D")
DOTS = np.kron(np.pad([[1]], ((1, 3), (1, 3))), np.ones((5, 5)))  # one in 25 px
DOTS = np.tile(DOTS, (10, 10))[:240, :240, None] > 0
RANDOM = np.random.default_rng(0).random((240, 240, 3))
UPPER = np.arange(240)[:, None, None] < 120
HIDDEN, DARK = "at most 15% of it hidden by objects, got ", "at least 40% of its light, got "
Wrong = Callable[[Picture], Any]
REFUSED: dict[str, tuple[Wrong, str]] = {
    "noise": (lambda good: 255 * RANDOM, HIDDEN),
    "half white": (lambda good: np.where(UPPER, 255, good), HIDDEN),
    "black": (lambda good: 0 * good, DARK),
    "white": (lambda good: 0 * good + 255, HIDDEN),
    "gray": (lambda good: 0 * good + 128, HIDDEN),
    "swapped colors": (lambda good: good[..., ::-1], HIDDEN),
    "overexposed": (lambda good: np.minimum(good * 3.0, 255), HIDDEN),
    "salt": (lambda good: np.where(RANDOM[..., :1] < 0.2, 255, good), HIDDEN),
    "dots": (lambda good: np.where(DOTS, 0, good), "at most 60 objects on it, got more"),
}
UNNOTICED: dict[str, Wrong] = {
    "a band": lambda good: np.where(UPPER & ~np.roll(UPPER, -16, 0), 0, good),
    "a little salt": lambda good: np.where(RANDOM[..., :1] < 0.02, 255, good),
    "upside down": lambda good: good[::-1],
    "shifted": lambda good: np.roll(good, 20, 1),
    "blurred": lambda good: cv2.GaussianBlur(good, (0, 0), 3),
    "without colors": lambda good: good.mean(-1, keepdims=True).repeat(3, -1),
}


class Scene:
    """Eight blocks, and the sight of a camera that has seen all of them once."""

    def __init__(self, sight: Sight) -> None:
        self.task, self.sight = ReachTask(CONFIG, DESIGN, 3), sight
        self.task.reset(1, "blocks-8")
        self.blocks = self.task.episode.blocks
        sight.begin()
        assert self.looks() == len(self.blocks) == 8

    def picture(self) -> Picture:
        state = self.task.simulation.model, self.task.simulation.data
        return self.sight.views[0].take(*state)

    def look(self, picture: Picture) -> str:
        picture = np.ascontiguousarray(picture, np.uint8)
        return self.sight.look([picture], self.task.simulation.joint_position)

    def looks(self, times: int = 1) -> int:
        """Look at good pictures; how many objects have a row then."""
        for _ in range(times):
            assert not self.look(self.picture())
        return len(self.sight.tracker.tracks)

    def objects(self) -> Float32:
        """The rows of objects, [N, F], in the table's frame."""
        return self.sight.objects(np.eye(7)[6])[1:]

    def arrange(self, *blocks: Block) -> None:
        self.task.simulation.place(replace(self.task.episode, blocks=blocks))


@pytest.fixture
def scene(calibration: Cameras) -> Iterator[Scene]:
    sight = sight_of(CONFIG, calibration.to_text())
    yield Scene(sight)
    sight.close()


def test_a_picture_that_scarcely_shows_the_table_changes_nothing(scene: Scene) -> None:
    before, good = scene.objects(), scene.picture()
    for name, (wrong, why) in REFUSED.items():
        began = time.perf_counter()
        assert f"expected the table as calibrated, {why}" in scene.look(wrong(good)), name
        assert time.perf_counter() - began < 2.0, "noise took 25 s"
        assert (scene.objects() == before).all(), name


@pytest.mark.parametrize("name", UNNOTICED)
def test_another_wrong_picture_leaves_no_object(scene: Scene, name: str) -> None:
    before, wrong = scene.objects(), UNNOTICED[name](scene.picture())
    assert not scene.look(wrong)
    assert {len(scene.objects()), *(scene.looks() for _ in range(LOST))} == {8}
    assert np.allclose(scene.objects(), before, atol=0.01)
    # What the first picture of an episode showed is forgotten.
    scene.sight.begin()
    scene.look(wrong)
    assert scene.looks(LOST + SIGHTINGS) == 8


def test_an_object_needs_three_pictures_and_is_gone_after_ten(scene: Scene) -> None:
    x, y = -0.65 * (hand := scene.sight.views[0].hand[:2]) / np.linalg.norm(hand)
    scene.arrange(*scene.blocks, replace(scene.blocks[0], x=x, y=y))
    assert [scene.looks() for _ in range(SIGHTINGS)] == [8] * (SIGHTINGS - 1) + [9]
    scene.arrange(*scene.blocks[1:])
    assert [scene.looks() for _ in range(LOST)] == [9] * (LOST - 1) + [7]


def test_a_block_that_the_hand_hides_keeps_its_row(scene: Scene) -> None:
    for _ in range(60):
        scene.task.step(scripted_action(scene.task))
    assert scene.looks(3 * LOST) == 8
    assert max(track.age for track in scene.sight.tracker.tracks) == 3 * LOST
