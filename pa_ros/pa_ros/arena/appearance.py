"""Blocks as bodies: shape, size, color and density, from the properties of a block.

`APPEARANCES` has an entry for each property group that shows; the entry changes a `Look` by the
group's value. A group without an entry shows only in the features.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from pa_ros.arena.designs import Kind
from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import Registry
from pa_ros.language.syntax import SIZE
from pa_ros.world.relation import BLOCK_M
from pa_ros.world.schema import MIDDLE_EDGE_M, PLACE, SIZED

# Our own sizes; the paper gives none.
# Half the cube's edge, half the cylinder's height, and the radius of sphere and cylinder.
BLOCK_HALF_SIZE_M = BLOCK_M / 2
CAPSULE_RADIUS_M = 0.025
CAPSULE_HALF_LENGTH_M = 0.025  # the capsule lies on its side, along the block's x axis

PLACE_RADIUS_M = 0.06  # of a place, a disk on the table
RESTING_DEPTH_M = {"CUBE": 4.36e-5, "SPHERE": 1.69e-4, "CYLINDER": 4.4e-5, "CAPSULE": 8.66e-5}
"""How far each shape sinks into the table, measured (tests/arena/test_physics.py). MuJoCo's contact
is soft, and the depth doesn't depend on the mass. A block that starts at this depth does not move
when it wakes."""

COLOR_RGBA = {
    "RED": "0.85 0.15 0.15 1",
    "GREEN": "0.15 0.65 0.2 1",
    "BLUE": "0.15 0.3 0.85 1",
    "YELLOW": "0.95 0.85 0.1 1",
    "MAGENTA": "0.85 0.15 0.75 1",
}


@dataclass(frozen=True)
class Look:
    """A block of one of four shapes, with a size, a color and a density, or a disk for a place.

    The pose of a place is that of a block that stands on it.
    """

    shape: str = "CUBE"  # a key of RESTING_DEPTH_M, or PLACE
    scale: float = 1.0  # factor of the lengths above
    rgba: str = "0.5 0.5 0.5 1"
    density: float = 1.0  # factor of the mass that the arena gives to a block
    has_body: bool = True  # whether it can be touched and moved
    lift_m: float = 0.0  # how far above its pose a place is shown

    def __post_init__(self) -> None:
        shapes = [*RESTING_DEPTH_M, PLACE]
        if self.shape not in shapes:
            raise ConfigError(f"shape: expected one of {shapes}, got {self.shape!r}")

    @property
    def solid(self) -> Look:
        """The same look in grey: all that the physics depends on."""
        return replace(self, rgba=Look.rgba)

    @property
    def marker(self) -> str:
        """The matplotlib marker of this shape, seen from above."""
        markers = {"CUBE": "s", "SPHERE": "o", "CYLINDER": "H", "CAPSULE": "D", PLACE: "o"}
        return markers[self.shape]

    @property
    def rgb(self) -> tuple[float, ...]:
        """Red, green and blue in [0, 1]."""
        return tuple(float(value) for value in self.rgba.split()[:3])

    @property
    def rest_height(self) -> float:
        """Height of a resting block's center above the table, m."""
        half = CAPSULE_RADIUS_M if self.shape == "CAPSULE" else BLOCK_HALF_SIZE_M
        return half * self.scale - RESTING_DEPTH_M.get(self.shape, 0.0)

    @property
    def geometry(self) -> str:
        """Attributes of an MJCF geom."""
        half, radius = BLOCK_HALF_SIZE_M * self.scale, CAPSULE_RADIUS_M * self.scale
        return {
            "CUBE": f'type="box" size="{half} {half} {half}"',
            "SPHERE": f'type="sphere" size="{half}"',
            "CYLINDER": f'type="cylinder" size="{half} {half}"',
            "CAPSULE": f'type="capsule" size="{radius} {CAPSULE_HALF_LENGTH_M * self.scale}"'
            ' quat="0.7071067811865476 0 0.7071067811865476 0"',
            PLACE: f'type="cylinder" size="{PLACE_RADIUS_M * self.scale} 0.001" '
            f'pos="0 0 {0.003 - half + self.lift_m}"',
        }[self.shape]


APPEARANCES: Registry[Callable[[Look, str], Look]] = Registry("appearance")
APPEARANCES.register("shape", lambda look, value: replace(look, shape=value))
# A custom color without an entry stays grey.
APPEARANCES.register(
    "color", lambda look, value: replace(look, rgba=COLOR_RGBA.get(value, look.rgba))
)
APPEARANCES.register(
    SIZE,
    lambda look, value: with_edge(look, MIDDLE_EDGE_M + SIZED[SIZE].features.prototypes[value][0]),
)


def with_edge(look: Look, edge_m: float) -> Look:
    """The same look in another size: that of a cube with this edge."""
    return replace(look, scale=edge_m / (2 * BLOCK_HALF_SIZE_M))


@lru_cache(maxsize=4096)
def look_of(kind: Kind) -> Look:
    """The look of a block with these properties; ConfigError, with group and value, if it has
    none."""
    look = Look()
    for group, value in kind.items():
        if group in APPEARANCES:
            try:
                look = APPEARANCES[group](look, value)
            except ConfigError as error:
                raise ConfigError(f"appearance of {group}: {value}: {error}") from error
    return look
