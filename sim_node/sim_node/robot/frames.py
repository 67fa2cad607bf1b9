"""The newest transforms of tf, and poses along the chain that joins two frames. Without ROS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

from pa_ros.arena.errors import ArenaError
from pa_ros.core.experience import Float64
from pa_ros.core.text import did_you_mean
from pa_ros.world.poses import IDENTITY, in_base, in_hand

DEEPEST = 100  # frames from one to the root: bounds the work, and a circle has no end
SUGGESTED = 200  # frames that are remembered for suggestions


@dataclass(frozen=True)
class Placed:
    """A pose, when it was measured, and when it arrived."""

    pose: Float64  # [7] x y z (m), quaternion xyzw, in the parent's frame
    stamp_ns: int = 0  # on the sender's clock; 0: not given
    arrived_s: float = inf  # on the receiver's monotonic clock; inf: it never changes


class FrameTree:
    """The newest transform of each frame.

    Ages are from arrival, so that clocks of several machines need not agree. A transform with the
    stamp of the one before it is the same measurement sent again, and does not count as new.
    """

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Placed]] = {}
        self._targets: tuple[str, ...] = ()
        self._heard: set[str] = set()
        self.wanted: tuple[str, ...] = ()

    def want(self, frames: Iterable[str]) -> None:
        """Say which frames' poses will be asked for: `wanted` are these and all above them."""
        self._targets = tuple(frames)
        self.wanted = tuple(dict.fromkeys(one for name in self._targets for one in self._up(name)))

    def hear(self, names: set[str]) -> None:
        """Remember names of frames, to suggest one of them for a misspelled one."""
        if len(self._heard) < SUGGESTED:
            self._heard |= names

    def add(self, parent: str, child: str, placed: Placed) -> None:
        """Keep a transform of `child`.

        Raises ArenaError (`robot.frames`) if it puts a circle or too many frames above a wanted
        one; the tree then is as before.
        """
        known = self._parents.get(child)
        if known and placed.stamp_ns and known[1].stamp_ns == placed.stamp_ns:
            return
        self._parents[child] = parent, placed
        if child not in self.wanted or (known and known[0] == parent):
            return
        try:
            self.want(self._targets)
        except ArenaError:
            del self._parents[child]
            self._parents |= {child: known} if known else {}
            raise

    def pose(self, base: str, frame: str) -> Placed:
        """Where `frame` is in `base`, as old as the oldest transform from either to the root.

        Raises ArenaError (`robot.poses`) if nothing joins the two.
        """
        ours, theirs = self._up(frame), self._up(base)
        if [*ours][-1] != [*theirs][-1]:
            known = {*self._parents, *(parent for parent, _ in self._parents.values())}
            known |= self._heard
            hints = (did_you_mean(name, known) for name in (base, frame) if name not in known)
            raise ArenaError(
                f"tf does not join {frame!r} and {base!r}{''.join(hints)}", code="robot.poses"
            )
        chain = *ours.values(), *theirs.values()
        return Placed(
            in_hand(_product(theirs), _product(ours)),
            min((placed.stamp_ns for placed in chain if placed.stamp_ns), default=0),
            min(placed.arrived_s for placed in chain),
        )

    def _up(self, name: str) -> dict[str, Placed]:
        """The frames from `name` up to the root, each with its pose in the next one."""
        found: dict[str, Placed] = {}
        while name in self._parents:
            if name in found or len(found) == DEEPEST:
                raise ArenaError(
                    f"tf: expected a tree of at most {DEEPEST} frames one above another, got more, "
                    f"or a circle, at {name!r}",
                    code="robot.frames",
                )
            parent, found[name] = self._parents[name]
            name = parent
        return found | {name: Placed(IDENTITY)}


def _product(chain: dict[str, Placed]) -> Float64:
    """The pose of the first frame of a chain in its last one."""
    pose = IDENTITY
    for placed in chain.values():
        pose = in_base(placed.pose, pose)
    return pose
