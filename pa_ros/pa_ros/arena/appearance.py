"""What a block of some properties looks like, and what it is made of.

Each property group has an entry in `APPEARANCES`: what its value makes of a look. One without an
entry is seen in the features alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from pa_ros.arena import constants as c
from pa_ros.arena.designs import Kind
from pa_ros.core.registry import Registry


@dataclass(frozen=True)
class Look:
    """A block: one of our shapes, larger or smaller, of a color and a weight."""

    shape: str = "CUBE"  # of constants.RESTING_DEPTH_M
    scale: float = 1.0  # of the lengths in arena.constants
    rgba: str = "0.5 0.5 0.5 1"
    density: float = 1.0  # of the mass that the arena gives to a block

    @property
    def solid(self) -> Look:
        """The same in grey: what physics depends on."""
        return replace(self, rgba=Look.rgba)

    @property
    def marker(self) -> str:
        """Of matplotlib, seen from above."""
        return {"CUBE": "s", "SPHERE": "o", "CYLINDER": "H", "CAPSULE": "D"}[self.shape]

    @property
    def rgb(self) -> tuple[float, ...]:
        """For a picture."""
        return tuple(float(value) for value in self.rgba.split()[:3])

    @property
    def rest_height(self) -> float:
        """Height of a resting block's center above the table, m."""
        half = c.CAPSULE_RADIUS_M if self.shape == "CAPSULE" else c.BLOCK_HALF_SIZE_M
        return half * self.scale - c.RESTING_DEPTH_M[self.shape]

    @property
    def geometry(self) -> str:
        """Of an MJCF geom."""
        half, radius = c.BLOCK_HALF_SIZE_M * self.scale, c.CAPSULE_RADIUS_M * self.scale
        return {
            "CUBE": f'type="box" size="{half} {half} {half}"',
            "SPHERE": f'type="sphere" size="{half}"',
            "CYLINDER": f'type="cylinder" size="{half} {half}"',
            "CAPSULE": f'type="capsule" size="{radius} {c.CAPSULE_HALF_LENGTH_M * self.scale}"'
            ' quat="0.7071067811865476 0 0.7071067811865476 0"',
        }[self.shape]


APPEARANCES: Registry[Callable[[Look, str], Look]] = Registry("appearance")
APPEARANCES.register("shape", lambda look, value: replace(look, shape=value))
APPEARANCES.register("color", lambda look, value: replace(look, rgba=c.COLOR_RGBA[value]))


@lru_cache(maxsize=4096)
def look_of(kind: Kind) -> Look:
    """What a block of these properties looks like."""
    look = Look()
    for group, value in kind.items():
        if group in APPEARANCES:
            look = APPEARANCES[group](look, value)
    return look
