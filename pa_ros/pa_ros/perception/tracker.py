"""Assigns blobs to objects, from picture to picture and between cameras, by nearest neighbors.

Where the arm does not touch blocks, a hidden block stays where it was. Where the arm pushes blocks,
it often hides the one that it pushes; `fitting` then estimates the block's position. A block that
is seen elsewhere afterwards keeps its row.

A camera's pictures may be wrong. There an object that appears later gets a row when it was seen in
SIGHTINGS pictures in a row, and loses it after LOST pictures of the bare table at its place. What
the arm, or anything else, hides keeps its row. Looks are renewed after as many pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.blobs import Blob
from pa_ros.perception.fitting import fitted
from pa_ros.perception.looks import color
from pa_ros.perception.view import Mask, View

MOST = 15  # objects
NEAR_M = 0.05  # a blob within this of a track is of the track
AGAIN_M = 0.20  # a pushed block is found again at most so far from where it was expected
SAME_COLOR = 0.25  # and its color differs by less, in shares of red, green and blue
MOVED_M = 0.02  # a blob farther away than this from its track has moved
NEWEST = 0.3  # weight of the newest position of what lies still
SIGHTINGS, LOST = 3, 10  # pictures
TOUCH_M, LOW_M = 0.07, 0.12  # distance to a hand that touches a block, and its greatest height


@dataclass(eq=False)
class Track:
    """One object, at a row of the observation for a whole episode."""

    xy: Float64  # [2] m on the table
    looks: dict[int, Blob]  # each camera's best look at it
    age: int = 0  # updates since it was seen last
    sightings: int = 0  # updates that saw it, before it has a row
    looks_age: int = 0  # updates since its looks changed
    bare: int = 0  # updates since it was seen that saw the bare table at its place
    properties: Float32 | None = None  # of these looks, once computed
    whole: dict[int, Blob] = field(default_factory=dict)  # each camera's last picture of all of it

    def __post_init__(self) -> None:
        self.before = self.xy  # at the update before

    @property
    def covered(self) -> bool:
        """Whether no camera has seen it whole."""
        return all(look.covered for look in self.looks.values())


class PushingArm(NamedTuple):
    """An arm that pushes blocks."""

    hand: Float64  # [3] m, where it is
    free: Sequence[tuple[View, Mask]]  # each camera, and its pixels that the arm does not cover


class Tracker:
    """At most `most` objects; the order of its tracks is that of the observation's rows.

    A blob that is covered in part does not change how a track looks, unless nothing better was ever
    seen of it, and moves it only where blocks are pushed.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self.tracks: list[Track] = []
        self._new: list[Track] = []  # without a row
        self._begins = True  # what the first picture shows has rows at once

    def update(
        self,
        blobs: Sequence[Blob],
        arm: PushingArm | None = None,
        is_bare: Callable[[Float64], bool] | None = None,
    ) -> None:
        """Take in the blobs of a new picture from each camera, and where the arm pushes blocks, the
        arm.

        :param is_bare: whether the picture shows the bare table at a place [2], m. None: pictures
            are never wrong; objects have rows at once, and keep them.
        """
        known = [*self.tracks, *self._new]
        for track in known:
            track.age += 1
            track.looks_age += is_bare is not None
        parts: dict[Track, dict[int, Blob]] = {track: {} for track in known}
        elsewhere = []
        for blob in sorted(blobs, key=lambda blob: (blob.covered, blob.camera, -blob.area)):
            near = [track for track in known if _apart(track, blob) < NEAR_M]
            if free := [track for track in near if blob.camera not in parts[track]]:
                track = _nearest(free, blob)
                _follow(track, blob)
                parts[track][blob.camera] = blob
            elif not near:
                elsewhere.append(blob)
        for blob in elsewhere:
            self._place(blob, parts, pushes=arm is not None)
        certain = self._new if is_bare is None or self._begins else self._certain(is_bare)
        self.tracks += certain
        self._new = [track for track in self._new if track not in certain]
        self._begins = False
        if arm is not None:
            for track in self.tracks:
                _fit(track, parts[track], arm)

    def _place(self, blob: Blob, parts: dict[Track, dict[int, Blob]], pushes: bool) -> None:
        """Take in a blob that is near no track: a new object, or one that was pushed unseen."""
        near = [track for track in parts if _apart(track, blob) < NEAR_M]  # new ones
        pushed = [track for track in parts if pushes and _is_again(track, blob)]
        if free := [track for track in near or pushed if blob.camera not in parts[track]]:
            track = _nearest(free, blob)
            if not near and track.age == 0:
                return  # another camera sees where it is
            if not near:
                track.xy = track.before = blob.xy
            _follow(track, blob)
        elif near or len(parts) == self._most:
            return
        else:
            track = Track(blob.xy, {blob.camera: blob})
            self._new.append(track)
        parts.setdefault(track, {})[blob.camera] = blob

    def _certain(self, is_bare: Callable[[Float64], bool]) -> list[Track]:
        """Take rows away, or else say which new tracks get one. Never both at once: agents notice
        another order of the rows by their number."""
        for track in self.tracks:
            track.bare = track.bare + is_bare(track.xy) if track.age else 0
        self._new = [track for track in self._new if track.age == 0]
        for track in self._new:
            track.sightings += 1
        kept = [track for track in self.tracks if track.bare < LOST]
        lost, self.tracks = len(self.tracks) - len(kept), kept
        return [] if lost else [track for track in self._new if track.sightings >= SIGHTINGS]


def _apart(track: Track, blob: Blob) -> float:
    return float(np.linalg.norm(track.xy - blob.xy))


def _nearest(tracks: Sequence[Track], blob: Blob) -> Track:
    return min(tracks, key=lambda track: _apart(track, blob))


def _is_again(track: Track, blob: Blob) -> bool:
    """Whether a blob may be of a block that was pushed while it was hidden."""
    if _apart(track, blob) >= AGAIN_M:
        return False
    known = next(iter(track.looks.values()))
    return bool(np.linalg.norm(color(known) - color(blob)) < SAME_COLOR)


def _follow(track: Track, blob: Blob) -> None:
    own, moved = track.looks.get(blob.camera), _apart(track, blob) > MOVED_M
    better = own is None or blob.area > own.area or track.looks_age >= LOST
    # The first blob of an update is of the camera that sees the object best.
    steers, track.age = track.age > 0, 0
    if steers and not blob.covered and not track.covered and not moved:
        track.xy = (1 - NEWEST) * track.xy + NEWEST * blob.xy
    elif steers and (not blob.covered or (track.covered and better)):
        track.xy = blob.xy
    whole = own is not None and not own.covered
    if blob.covered:
        looks_better = not whole and better
    else:
        looks_better = not whole or moved or better
    if looks_better:
        track.looks[blob.camera], track.properties, track.looks_age = blob, None, 0


def _fit(track: Track, seen: dict[int, Blob], arm: PushingArm) -> None:
    """Move a track that no camera's blob shows whole to the position that explains them best."""
    whole = {camera: blob for camera, blob in seen.items() if not blob.covered}
    track.whole |= whole
    if not whole:
        camera = min(seen or track.looks)
        last = _pushed(track.before, arm.hand)
        known, part = track.whole.get(camera), seen.get(camera)
        track.xy = fitted(*arm.free[camera], last, known, part)
    track.before = track.xy


def _pushed(xy: Float64, hand: Float64) -> Float64:
    """The position of a block that was at `xy`: outside of the hand, which pushes it."""
    away = xy - hand[:2]
    distance = float(np.linalg.norm(away))
    touches = hand[2] < LOW_M and 0 < distance < TOUCH_M
    return hand[:2] + away * (TOUCH_M / distance) if touches else xy
