"""Which blob of one picture is which of the next: nearest neighbours. Hidden blocks lie still."""

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
    blob: Blob  # the best look at it
    age: int = 0  # pictures since it was seen last
    properties: Float32 | None = None  # of that look, once computed

    def see(self, xy: Float64, blob: Blob) -> None:
        """Move it, and look at it anew."""
        self.xy, self.blob, self.properties = xy, blob, None


class Tracker:
    """At most `most` objects; the order of its tracks is that of the observation's rows.

    A blob that is covered in part neither moves a track nor changes how it looks, unless nothing
    better was ever seen of it.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self.tracks: list[Track] = []

    def update(self, blobs: Sequence[Blob]) -> None:
        """Take in the blobs of a new picture."""
        for track in self.tracks:
            track.age += 1
        free = list(self.tracks)
        for blob in sorted(blobs, key=lambda blob: (blob.covered, -blob.area)):
            near = [track for track in free if _apart(track, blob) < NEAR_M]
            if near:
                track = min(near, key=lambda track: _apart(track, blob))
                free.remove(track)
                _follow(track, blob)
            elif len(self.tracks) < self._most:
                if all(_apart(track, blob) >= NEAR_M for track in self.tracks):
                    self.tracks.append(Track(blob.xy, blob))


def _apart(track: Track, blob: Blob) -> float:
    return float(np.linalg.norm(track.xy - blob.xy))


def _follow(track: Track, blob: Blob) -> None:
    track.age, better = 0, blob.area > track.blob.area
    if blob.covered:
        if track.blob.covered and better:
            track.see(blob.xy, blob)
    elif track.blob.covered or _apart(track, blob) > MOVED_M:
        track.see(blob.xy, blob)
    else:
        track.xy = (1 - NEWEST) * track.xy + NEWEST * blob.xy
        if better:
            track.see(track.xy, blob)
