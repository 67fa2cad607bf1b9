"""From pictures of one episode to the rows of an observation."""

from __future__ import annotations

import cv2
import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import ArenaConfig
from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.blobs import Blob, blobs
from pa_ros.perception.calibration import Calibration
from pa_ros.perception.tracker import Tracker
from pa_ros.perception.view import BLOCK_M, PLANE_M, Mask, Picture, View
from pa_ros.world.poses import POSE_WIDTH, in_hand

SEEN_NOW, REMEMBERED = (255, 255, 255), (150, 150, 150)  # colors of boxes
HIDES = 0.6  # of a block's side: a smaller part of the table that was never seen hides no block


class Sight:
    """What was seen since the episode began. How many objects there are is not known.

    A row of an observation is of one object until the episode ends, also while it is not seen. Rows
    are added as objects are found.
    """

    def __init__(self, config: ArenaConfig, calibration: Calibration) -> None:
        """RenderError where there is no OpenGL."""
        size = calibration.width, calibration.height
        view = self.view = View(config, calibration.view, *size)
        self.calibration = calibration
        v, u = np.mgrid[: view.height, : view.width]
        radius = np.linalg.norm(view.on_plane(u, v, PLANE_M), axis=-1)
        low, high = ARMS[config.arm].block_radii_m
        self._within_reach: Mask = (radius > low - BLOCK_M / 2) & (radius < high + BLOCK_M / 2)
        side = int(HIDES * BLOCK_M * view.pixels_per_m(np.zeros(2)))
        self._hides_block = np.ones((side, side), np.uint8)
        self.begin()

    def begin(self) -> None:
        """Forget what was seen: another episode begins."""
        self.tracker = Tracker()
        self.arm: Mask | None = None  # in the newest picture
        self._never_seen = self._within_reach.copy()

    def look(self, picture: Picture, joint_position: Float64) -> list[Blob]:
        """Take in a picture, and the joints (rad) when it was taken; its blobs.

        PerceptionError, with nothing changed, for a picture of another size.
        """
        self.view.check(picture)
        arm = self.arm = self.view.arm(joint_position)
        found = blobs(self.view, picture, arm)
        self.tracker.update(found)
        self._never_seen &= arm
        return found

    @property
    def complete(self) -> bool:
        """Whether more pictures would show nothing new of blocks that lie still."""
        if any(track.blob.covered for track in self.tracker.tracks) or self.arm is None:
            return False
        hidden = cv2.erode(self._never_seen.astype(np.uint8), self._hides_block)
        return not hidden.any()

    def objects(self, hand_pose: Float64) -> Float32:
        """Object features [1 + tracks, F] in the frame of the hand, whose pose [7] is in the
        base's; the hand's first."""
        tracks, properties = self.tracker.tracks, self._properties()
        poses = np.zeros((1 + len(tracks), POSE_WIDTH))
        poses[:, 2], poses[:, 6] = PLANE_M, 1.0
        poses[0] = hand_pose
        poses[1:, :2] = np.array([track.xy for track in tracks]).reshape(-1, 2)
        objects = np.zeros((len(poses), POSE_WIDTH + properties.shape[1]), np.float32)
        objects[:, :POSE_WIDTH] = in_hand(hand_pose, poses)
        objects[1:, POSE_WIDTH:] = properties
        return objects

    def drawn(self, picture: Picture) -> Picture:
        """The picture with a box around each object: its row, and the groups that are new."""
        shown, properties = picture.copy(), self._properties()
        for row, track in enumerate(self.tracker.tracks):
            left, top, right, bottom = track.blob.box
            words, start = [str(row + 1)], 0
            for name, channel in self.calibration.channels.items():
                if not properties[row, start : start + channel.width].any():
                    words.append(f"new {name}")
                start += channel.width
            ink, place = REMEMBERED if track.age else SEEN_NOW, (left, top - 3)
            cv2.rectangle(shown, (left, top), (right, bottom), ink)
            cv2.putText(shown, " ".join(words), place, cv2.FONT_HERSHEY_SIMPLEX, 0.35, ink)
        return shown

    def _properties(self) -> Float32:
        """[tracks, properties]; computed again only where a better look was had."""
        for track in self.tracker.tracks:
            if track.properties is None:
                track.properties = self.calibration.features(track.blob)
        width = sum(channel.width for channel in self.calibration.channels.values())
        known = [track.properties for track in self.tracker.tracks]
        return np.array(known, np.float32).reshape(-1, width)
