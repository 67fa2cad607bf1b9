"""Object rows of an observation from the pictures of one episode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.camera import PLAIN, Pictures
from pa_ros.arena.config import ArenaConfig
from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.blobs import Blob, blobs, uncovered
from pa_ros.perception.calibration import Cameras
from pa_ros.perception.errors import PerceptionError
from pa_ros.perception.looks import NEEDS_ALL
from pa_ros.perception.tracker import PushingArm, Tracker
from pa_ros.perception.view import BLOCK_M, PLANE_M, Mask, Picture, View
from pa_ros.world.poses import POSE_WIDTH, in_hand
from pa_ros.world.schema import PAPER, ObjectSchema

SEEN_NOW, REMEMBERED = (255, 255, 255), (150, 150, 150)  # colors of boxes
FONT = cv2.FONT_HERSHEY_SIMPLEX
HIDES = 0.6  # of a block's side: a smaller part of the table that was never seen hides no block


class Sight:
    """All objects seen since the episode began. Their true number is not known.

    A row of an observation is of one object until the episode ends, also while it is not seen. Rows
    are added as objects are found. `tracker` says when pictures that may be wrong take rows away.
    """

    def __init__(
        self,
        config: ArenaConfig,
        cameras: Cameras,
        pictures: Pictures = PLAIN,
        schema: ObjectSchema | None = None,
        rendered: bool = True,
    ) -> None:
        """RenderError where there is no OpenGL.

        :param schema: of the observations (`Cameras.schema`); None: a world without places.
        :param rendered: whether pictures come from a simulation, and so are never wrong.
        """
        self.schema = schema or cameras.schema(PAPER)
        sizes = [(one.view, one.width, one.height) for one in cameras.each]
        self.views = [View(config, *size, pictures) for size in sizes]
        self.cameras, view = cameras, self.views[0]
        self._rendered = rendered
        self._pushes = config.arm_touches_blocks
        self._first = 1  # row of the first track
        v, u = np.mgrid[: view.height, : view.width]
        places = view.on_plane(u, v, PLANE_M)
        radius = np.linalg.norm(places, axis=-1)
        low, high = ARMS[config.arm].block_radii_m
        self._within_reach: Mask = (radius > low - BLOCK_M / 2) & (radius < high + BLOCK_M / 2)
        # Where the other cameras see the places that the first camera's pixels show.
        self._same_place = [one.pixels(places, PLANE_M) for one in self.views[1:]]
        side = int(HIDES * BLOCK_M * view.pixels_per_m(np.zeros(2)))
        self._hides_block = np.ones((side, side), np.uint8)
        self.begin()

    def close(self) -> None:
        """Free the resources of OpenGL."""
        for view in self.views:
            view.close()

    def begin(self) -> None:
        """Forget what was seen: another episode begins."""
        self.tracker = Tracker()
        self.looked = False  # whether a picture was taken in
        self._never_seen = self._within_reach.copy()

    def look(self, pictures: Sequence[Picture], joint_position: Float64) -> str:
        """Take in a picture of each camera, and the joints (rad) when they were taken.

        Returns why a picture was not taken in, because it scarcely shows the table, with nothing
        changed; else an empty text. PerceptionError for a picture of another size.
        """
        for view, picture in zip(self.views, pictures, strict=True):
            view.check(picture)
        arms = [view.arm(joint_position) for view in self.views]
        try:
            seen = [blobs(*given) for given in zip(self.views, pictures, arms, strict=True)]
        except PerceptionError as error:
            return str(error)
        self.looked, found, free = True, [], []
        for camera, (view, arm) in enumerate(zip(self.views, arms, strict=True)):
            found += [replace(blob, camera=camera) for blob in seen[camera]]
            free.append((view, uncovered(view, arm)))
            if camera > 0:
                u, v = self._same_place[camera - 1]
                outside = (u < 0) | (v < 0) | (u >= view.width) | (v >= view.height)
                arm = outside | arm[v.clip(0, view.height - 1), u.clip(0, view.width - 1)]
            self._never_seen &= arm
        pushing = PushingArm(self.views[0].hand, free) if self._pushes else None
        self.tracker.update(found, pushing, None if self._rendered else _bare(free, seen))
        return ""

    @property
    def complete(self) -> bool:
        """Whether more pictures would show nothing new of blocks that lie still."""
        if any(track.covered for track in self.tracker.tracks) or not self.looked:
            return False
        hidden = cv2.erode(self._never_seen.astype(np.uint8), self._hides_block)
        return not hidden.any()

    def objects(self, hand_pose: Float64, told: Float32 | None = None) -> Float32:
        """Object features [1 + told + tracks, F] in the frame of the hand, whose pose [7] is in the
        base's: the hand's row first, then the rows `told` of places, then the tracks'.
        """
        tracks, schema = self.tracker.tracks, self.schema
        poses = np.zeros((1 + len(tracks), POSE_WIDTH))
        poses[:, 2], poses[:, 6] = PLANE_M, 1.0
        poses[0] = hand_pose[:POSE_WIDTH]
        poses[1:, :2] = np.array([track.xy for track in tracks]).reshape(-1, 2)
        objects = np.zeros((len(poses), schema.width), np.float32)
        objects[:, :POSE_WIDTH] = in_hand(hand_pose, poses)
        objects[1:, schema.seen_columns] = self._properties()
        if told is None:
            return objects
        self._first = 1 + len(told)
        return np.concatenate([objects[:1], told, objects[1:]])

    def drawn(self, pictures: Sequence[Picture]) -> Picture:
        """The pictures, beside each other, with a box around each object: its row, and the groups
        that are new."""
        properties, drawn = self._properties(), []
        for camera, picture in enumerate(pictures):
            shown = picture.copy()
            for row, track in enumerate(self.tracker.tracks):
                words, start = [str(row + self._first)], 0
                for name, width in self.cameras.widths.items():
                    unknown = name in NEEDS_ALL and track.covered
                    if not unknown and not properties[row, start : start + width].any():
                        words.append(f"new {name}")
                    start += width
                if camera in track.looks:
                    left, top, right, bottom = track.looks[camera].box
                    ink, place = REMEMBERED if track.age else SEEN_NOW, (left, top - 3)
                    cv2.rectangle(shown, (left, top), (right, bottom), ink)
                    cv2.putText(shown, " ".join(words), place, FONT, 0.35, ink)
            drawn.append(shown)
        return np.hstack(drawn)

    def _properties(self) -> Float32:
        """[tracks, properties]; computed again only where a better look was had."""
        for track in self.tracker.tracks:
            if track.properties is None:
                track.properties = self.cameras.features(track.looks)
        known = [track.properties for track in self.tracker.tracks]
        return np.array(known, np.float32).reshape(-1, sum(self.cameras.widths.values()))


def _bare(
    free: Sequence[tuple[View, Mask]], seen: Sequence[Sequence[Blob]]
) -> Callable[[Float64], bool]:
    """Whether a camera sees neither the arm nor one of its blobs at a place [2], m."""
    bare = [(view, uncovered | ~view.table) for view, uncovered in free]
    for (_, mask), found in zip(bare, seen, strict=True):
        for blob in found:
            left, top, right, bottom = blob.box
            mask[top : bottom + 1, left : right + 1] &= ~blob.pixels
    return lambda xy: any(view.shows(mask, xy) for view, mask in bare)
