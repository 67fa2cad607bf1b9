"""Pictures show each block at the pixel that the camera's numbers give."""

import mujoco
import numpy as np
import pytest

from helpers.pictures import opengl, pixel_of
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.arena.appearance import look_of
from pa_ros.arena.camera import CLOSE, PICTURES, Camera, Pictures, intrinsics, optical_pose
from pa_ros.arena.model import build_textured
from pa_ros.arena.render import draw

SIZES = [("overview", 320, 240), ("above", 200, 200), ("above", 640, 360)]


@pytest.fixture(scope="module")
def task() -> ReachTask:
    opengl()
    made = ReachTask(preset_named("fast"), design_named("3-D"), seed=0)
    made.reset(0)
    return made


def first_seen(model: mujoco.MjModel, data: mujoco.MjData, eye, place) -> str:
    """The first geom on the line from `eye` to a place."""
    geom = np.zeros(1, dtype=np.int32)
    mujoco.mj_ray(model, data, eye, place - eye, None, 1, -1, geom)
    return str(model.geom(int(geom[0])).name)


def hue(rgb) -> np.ndarray:
    """The color without light and gloss."""
    colorful = rgb - rgb.min()
    assert colorful.max() > 0.1, "grey"
    return colorful / np.linalg.norm(colorful)


@pytest.mark.parametrize(("view", "width", "height"), SIZES)
def test_a_block_is_at_the_pixel_to_which_it_projects(task: ReachTask, view, width, height):
    task.reset(0)
    model = task.simulation.model
    camera = Camera(model, view, width, height)
    matrix, pose = intrinsics(model, view, width, height), optical_pose(model, view)
    assert matrix[:2, 2].tolist() == [(width - 1) / 2, (height - 1) / 2]
    seen = 0
    try:
        for episode in range(4):  # other blocks, so other models
            task.reset(episode)
            simulation = task.simulation
            camera.look(simulation)
            picture = camera.picture()
            assert picture.shape == (height, width, 3)
            for i, block in enumerate(task.episode.blocks):
                place = simulation.positions[i + 1]
                met = first_seen(simulation.model, simulation.data, pose.position, place)
                if met != f"block{i}":
                    continue  # behind the arm, or another block
                u, v = pixel_of(place, matrix, pose.position, pose.quaternion)
                seen_hue = hue(picture[round(v), round(u)] / 255)
                assert seen_hue @ hue(np.array(look_of(block.kind).rgb)) > 0.95
                seen += 1
    finally:
        camera.close()
    assert seen >= 12  # of 16


def test_pictures_are_lit_as_asked_and_mark_the_target(task: ReachTask) -> None:
    model, seen = build_textured(task.config), dict[str, np.ndarray]()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for name, pictures in PICTURES.items():
        camera = Camera(model, "above", 64, 64, pictures)
        seen[name] = camera.of(model, data).astype(float)
        camera.close()
    light = [seen[name].mean() / seen["plain"].mean() for name in ("dim", "bright")]
    assert light == pytest.approx([0.7, 1.26], abs=0.05)
    assert (seen["noise"] - seen["plain"]).std() == pytest.approx(10, abs=1)
    darker = {name: (seen["plain"] - seen[name] > 20).any(2).mean() for name in seen}
    assert darker["plain"] == 0 < darker["shadows"] < 0.1 < darker["texture"] < 0.7
    task.reset(0)
    camera = Camera(task.simulation.model, CLOSE, 160, 120, Pictures(shadows=True))
    camera.look(task.simulation)
    marked, unmarked = draw(task, 160), camera.picture()
    camera.close()
    assert marked.shape == (120, 160, 3) and marked[0].mean() > 150, "a light background"
    assert 10 < (marked.astype(int) - unmarked > 60).all(2).sum() < 40, "a disk below a block"


@pytest.mark.parametrize("closed", [False, True])
def test_a_camera_that_goes_away_leaves_others_alone(task: ReachTask, closed: bool):
    model, data = task.simulation.model, task.simulation.data
    first, second = (Camera(model, "above", 64, 64) for _ in range(2))
    before = second.of(model, data)
    if closed:
        first.close()
    del first
    assert before.std() > 10
    np.testing.assert_array_equal(second.of(model, data), before)
    second.close()
