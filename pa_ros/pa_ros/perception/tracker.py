"""Which blob is of which object, in the next picture and in another camera's: nearest neighbours.

Hidden blocks lie still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.perception.blobs import Blob

MOST = 15  # objects
NEAR_M = 0.05  # a blob within this of a track is of the track
MOVED_M = 0.02  # a blob farther away than this from its track has moved
NEWEST = 0.3  # weight of the newest position of what lies still


@dataclass(eq=False)
class Track:
    """One object, at a row of the observation for a whole episode."""

    xy: Float64  # [2] m on the table
    looks: dict[int, Blob]  # each camera's best look at it
    age: int = 0  # updates since it was seen last
    properties: Float32 | None = None  # of these looks, once computed

    @property
    def covered(self) -> bool:
        """Whether no camera has seen it whole."""
        return all(look.covered for look in self.looks.values())


class Tracker:
    """At most `most` objects; the order of its tracks is that of the observation's rows.

    A blob that is covered in part neither moves a track nor changes how it looks, unless nothing
    better was ever seen of it.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self.tracks: list[Track] = []

    def update(self, blobs: Sequence[Blob]) -> None:
        """Take in the blobs of a new picture from each camera."""
        for track in self.tracks:
            track.age += 1
        taken: set[tuple[Track, int]] = set()
        for blob in sorted(blobs, key=lambda blob: (blob.covered, blob.camera, -blob.area)):
            near = [track for track in self.tracks if _apart(track, blob) < NEAR_M]
            free = [track for track in near if (track, blob.camera) not in taken]
            if free:
                track = min(free, key=lambda track: _apart(track, blob))
                _follow(track, blob)
            elif near or len(self.tracks) == self._most:
                continue
            else:
                track = Track(blob.xy, {blob.camera: blob})
                self.tracks.append(track)
            taken.add((track, blob.camera))


def _apart(track: Track, blob: Blob) -> float:
    return float(np.linalg.norm(track.xy - blob.xy))


def _follow(track: Track, blob: Blob) -> None:
    own, moved = track.looks.get(blob.camera), _apart(track, blob) > MOVED_M
    better = own is None or blob.area > own.area
    # The first blob of an update is of the camera that sees the object best.
    steers, track.age = track.age > 0, 0
    if steers and not blob.covered and not track.covered and not moved:
        track.xy = (1 - NEWEST) * track.xy + NEWEST * blob.xy
    elif steers and (track.covered and better if blob.covered else True):
        track.xy = blob.xy
    whole = own is not None and not own.covered
    if (not whole and better) if blob.covered else (not whole or moved or better):
        track.looks[blob.camera], track.properties = blob, None
