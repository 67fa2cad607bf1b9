"""Pictures of the arena: blocks are found, told apart, and kept in their rows."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pa_ros.arena import (
    Block,
    Kind,
    ReachTask,
    design_named,
    preset_named,
    scripted_action,
    training_programs,
)
from pa_ros.arena.camera import PICTURES
from pa_ros.bags.film import RecordedScene
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Step
from pa_ros.provenance.arena import describe
from pa_ros.world.poses import in_base
from pa_ros.world.schema import PLACE, Seen

pytest.importorskip("cv2", reason="no OpenCV: install programmable-agents[camera]")
from pa_ros.perception.blobs import Blob, blobs
from pa_ros.perception.calibration import Cameras
from pa_ros.perception.errors import PerceptionError
from pa_ros.perception.sight import Sight
from pa_ros.perception.task import CameraTask, calibrate
from pa_ros.perception.view import View

CONFIG, DESIGN = preset_named("fast"), design_named("3-D")
PUSHED = preset_named("push")
PROGRAMS = training_programs(DESIGN)


@pytest.fixture(scope="module")
def seen(calibration: Cameras) -> Iterator[CameraTask]:
    task = CameraTask(CONFIG, DESIGN, 7, calibration)
    yield task
    task.sight.close()


def found_in(view: View, task: ReachTask) -> Iterator[tuple[Blob, int, float]]:
    """Blobs, each with the block nearest to it and how far that is, m."""
    picture = view.take(task.simulation.model, task.simulation.data)
    true = task.simulation.positions[1:, :2]
    for blob in blobs(view, picture, view.arm(task.simulation.joint_position)):
        apart = np.linalg.norm(true - blob.xy, axis=1)
        yield blob, int(apart.argmin()), float(apart.min())


def test_blocks_are_found_where_they_are_and_the_arm_is_not_one_of_them(seen: CameraTask) -> None:
    errors, blocks = [], 0
    for episode in range(5):
        seen.reset(episode, "blocks-8")
        found = list(found_in(seen.sight.views[0], seen))
        blocks += len(seen.episode.blocks)
        assert len({block for _, block, _ in found}) == len(found)
        errors += [apart for _, _, apart in found]
    assert max(errors) < 0.03 and np.median(errors) < 0.002
    assert len(errors) >= 0.9 * blocks  # the arm hides some


@pytest.mark.parametrize("kinds", ["RED CUBE, BLUE CYLINDER", "RED CYLINDER, RED CYLINDER"])
def test_blocks_that_touch_are_two(seen: CameraTask, kinds: str) -> None:
    seen.reset(0)
    away = np.arctan2(*seen.simulation.positions[0, 1::-1]) + np.pi  # from the arm
    x, y = 0.4 * np.cos(away), 0.4 * np.sin(away)
    pair = tuple(
        Block(Kind(color=kind.split()[0], shape=kind.split()[1]), x, y + 0.061 * i, 0.0)
        for i, kind in enumerate(kinds.split(", "))
    )
    seen.simulation.place(replace(seen.episode, blocks=pair))
    found = [block for _, block, apart in found_in(seen.sight.views[0], seen) if apart < 0.015]
    assert sorted(found) == [0, 1]


@pytest.mark.parametrize(
    ("name", "view"), [("bright", "above"), ("hard", "above"), ("hard", "overview")]
)
def test_blocks_are_found_in_other_light_with_noise_shadows_and_texture(
    seen: CameraTask, name: str, view: str
) -> None:
    hard = View(CONFIG, view, 240, 240, PICTURES[name])
    plain = View(CONFIG, view, 240, 240)
    found: list[int] = []
    wrong: list[float] = []
    usual: list[int] = []
    for episode in range(2):
        seen.reset(episode, "blocks-8")
        usual += [block for _, block, apart in found_in(plain, seen) if apart < 0.03]
        for _, block, apart in found_in(hard, seen):
            (found if apart < 0.03 else wrong).append(block)
    hard.close()
    plain.close()
    assert len(usual) >= 14 and len(found) >= 0.95 * len(usual) and len(wrong) <= 2


def test_two_cameras_see_what_the_arm_hides_from_one(seen: CameraTask) -> None:
    above = seen.sight.cameras.each[0]
    corner = replace(above, view="overview")  # its looks are not used here
    task = CameraTask(CONFIG, DESIGN, 7, Cameras((above, corner)))
    try:
        one, two, all_ = 0, 0, 0
        for episode in (0, 6):
            seen.reset(episode, "blocks-6")
            observation, _ = task.reset(episode, "blocks-6")
            poses = observation.objects[1:, :7].astype(np.float64)
            places = in_base(observation.hand_pose, poses)[:, :2]
            true = task.simulation.positions[1:, :2]
            apart = np.linalg.norm(true[:, None] - places, axis=-1)
            assert (apart.min(0) < 0.03).all() and len(places) <= len(true)
            one, two, all_ = (
                one + len(seen.sight.tracker.tracks), two + len(places), all_ + len(true)
            )  # fmt: skip
        assert one < two == all_
    finally:
        task.close()


@pytest.mark.parametrize("name", ["above", "overview"])
def test_looks_unlike_all_that_is_known_are_zero_and_known_ones_are_not(name: str) -> None:
    """The threshold comes from known blocks alone; colors and shapes of others are new."""
    cameras = Cameras((calibrate(CONFIG, DESIGN, name, 240),))
    seen = CameraTask(CONFIG, DESIGN, 7, cameras)
    zero: dict[tuple[str, bool], list[bool]] = {}
    try:
        for episode in range(12):
            seen.reset(episode, "reach-new-both" if episode % 2 else "reach-new-shape")
            for blob, block, _ in found_in(seen.sight.views[0], seen):
                kind = seen.episode.blocks[block].kind
                for group, part in seen.seen_schema.slices.items():
                    row = cameras.features({0: blob})[part.start - 7 : part.stop - 7]
                    if not blob.covered:
                        is_new = kind[group] == DESIGN.novel[group]
                        zero.setdefault((group, is_new), []).append(not row.any())
    finally:
        seen.close()
    assert {key: np.mean(value) > 0.8 for key, value in zero.items()} == {
        ("shape", True): True, ("shape", False): False,
        ("color", True): True, ("color", False): False,
    }  # fmt: skip
    assert np.mean(zero["shape", False] + zero["color", False]) < 0.05


def test_observations_tell_places_but_no_words(seen: CameraTask) -> None:
    observation, verdict = seen.reset(3)
    tracks = len(seen.sight.tracker.tracks)
    assert observation.objects.shape == (1 + tracks, seen.world.object_features)
    poses = observation.objects[1:, :7].astype(np.float64)
    places = in_base(observation.hand_pose, poses)[:, :3]
    true = seen.simulation.positions[1:]
    assert all(np.linalg.norm(true - place, axis=1).min() < 0.02 for place in places)
    assert [type(group.features) for group in seen.seen_schema] == [Seen, Seen]
    with pytest.raises(ConfigError, match="expected properties that are told"):
        seen.world.truth(observation.objects)


def test_a_program_holds_where_its_measure_is_within_the_threshold(
    seen: CameraTask,
) -> None:
    seen.reset(2)
    for _ in range(30):
        _, verdict = seen.step(scripted_action(seen))
    assert verdict.measures is not None
    own = verdict.measures[list(map(str, PROGRAMS)).index(str(seen.program))]
    assert own == verdict.distance and verdict.satisfied == (own <= 0.2)
    present = {kind["color"] + kind["shape"] for kind in (b.kind for b in seen.episode.blocks)}
    named = {
        k["color"] + k["shape"]
        for k, m in zip(DESIGN.train, verdict.measures, strict=True)
        if m < np.inf
    }
    assert named == present & {k["color"] + k["shape"] for k in DESIGN.train}


def test_it_looks_until_nothing_can_be_hidden_and_rows_keep_their_objects(
    seen: CameraTask,
) -> None:
    first, _ = seen.reset(1)
    rows = len(seen.sight.tracker.tracks)
    before = [track.xy for track in seen.sight.tracker.tracks]
    for _ in range(60):
        seen.step(np.array(CONFIG.joint_speed_limits) * (1, 0, 0, 0, 0, 0))
    assert seen.sight.complete
    after = [track.xy for track in seen.sight.tracker.tracks]
    assert len(after) == len(seen.episode.blocks) >= rows
    assert np.allclose(before, after[:rows], atol=0.02)


def test_a_block_keeps_its_row_and_place_while_the_hand_that_pushes_it_hides_it(
    calibration: Cameras,
) -> None:
    task, sight = ReachTask(PUSHED, design_named("push-2"), 0), Sight(PUSHED, calibration)
    medians, hidden = [], 0
    for episode in (0, 3, 5, 6):
        verdict = task.reset(episode)[1]
        sight.begin()
        solid = [PLACE not in block.kind.words for block in task.episode.blocks]
        row, errors = -1, []
        moved = task.verifier.moved[0]
        while not verdict.truncated:
            state = task.simulation.model, task.simulation.data
            sight.look([sight.views[0].take(*state)], task.simulation.joint_position)
            places = np.array([track.xy for track in sight.tracker.tracks])
            apart = np.linalg.norm(places - task.simulation.positions[moved, :2], axis=1)
            row = int(apart.argmin()) if row < 0 and apart.min() < 0.02 else row
            errors.append(float(apart[row]))
            hidden += sight.tracker.tracks[row].age > 0
            verdict = task.step(scripted_action(task))[1]
        assert len(sight.tracker.tracks) == sum(solid)  # and no place, which has no body
        medians.append(np.median(errors[20:]))
    sight.close()
    assert hidden > 50 and max(medians) < 0.06 and np.median(medians) < 0.015


def test_a_picture_of_another_size_is_rejected(seen: CameraTask) -> None:
    with pytest.raises(PerceptionError, match="expected RGB of 240 x 240 px, as calibrated, got"):
        seen.sight.look([np.zeros((120, 160, 3), np.uint8)], np.zeros(6))


def test_places_are_told_where_blocks_are_seen(calibration: Cameras) -> None:
    task = CameraTask(PUSHED, design_named("push-2"), 0, calibration)
    observation, verdict = task.reset(0)
    labels = task.world.schema.labels(observation.objects, 0)
    assert labels == ("hand", "RED PLACE", "BLUE PLACE", "block 3", "block 4", "block 5", "block 6")
    poses = in_base(observation.hand_pose, observation.objects[1:, :7].astype(np.float64))
    for label, place in zip(labels[1:3], poses, strict=False):
        kinds = [" ".join([b.kind["color"], b.kind["shape"]]) for b in task.episode.blocks]
        true = task.simulation.positions[1 + kinds.index(label)]
        np.testing.assert_allclose(place[:3], true, atol=1e-5)
    assert verdict.measures is not None
    own = [str(p) for p in training_programs(task.design)].index(str(task.program))
    assert verdict.measures[own] == verdict.distance
    # Films show places as they are, and blocks in grey.
    about = replace(describe(PUSHED, task.design, 0, (), "a"), world=task.world)
    stage = RecordedScene(about, Step(observation))
    shapes = [block.look.shape for block in stage.task.episode.blocks]
    assert shapes == [PLACE, PLACE, "CUBE", "CUBE", "CUBE", "CUBE"]
    task.close()


def test_a_design_with_other_properties_is_rejected(calibration: Cameras) -> None:
    with pytest.raises(ConfigError, match=r"expected a design with the property groups \['shape'"):
        CameraTask(CONFIG, design_named("sizes"), 0, calibration)
