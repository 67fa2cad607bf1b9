"""What a block of some properties looks like, and what it is made of.

Each property group has an entry in `APPEARANCES`: what its value makes of a look. One without an
entry is seen in the features alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from pa_ros.arena import constants as c
from pa_ros.arena.designs import Kind
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.registry import Registry

MOST = 1000.0  # times ours, and as many times less


@dataclass(frozen=True)
class Look:
    """A block: one of our shapes, larger or smaller, of a color and a weight."""

    shape: str = "CUBE"  # of constants.RESTING_DEPTH_M
    scale: float = 1.0  # of the lengths in arena.constants
    rgba: str = "0.5 0.5 0.5 1"
    density: float = 1.0  # of the mass that the arena gives to a block

    def __post_init__(self) -> None:
        if self.shape not in c.RESTING_DEPTH_M:
            raise ConfigError(f"shape: expected one of {[*c.RESTING_DEPTH_M]}, got {self.shape!r}")
        for name, value in (("scale", self.scale), ("density", self.density)):
            if not (isinstance(value, (int, float)) and 1 / MOST <= value <= MOST):
                raise ConfigError(f"{name}: expected {1 / MOST:g} to {MOST}, got {value!r}")
        try:
            parts = [float(part) for part in self.rgba.split()]
        except (AttributeError, ValueError):
            parts = []
        if len(parts) != 4 or not all(0 <= part <= 1 for part in parts):
            raise ConfigError(
                f'rgba: expected four parts in [0, 1] as text, "0.5 0.5 0.5 1", got {self.rgba!r}'
            )

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
APPEARANCES.register(
    "color", lambda look, value: replace(look, rgba=c.COLOR_RGBA.get(value, look.rgba))
)


@lru_cache(maxsize=4096)
def look_of(kind: Kind) -> Look:
    """What a block of these properties looks like; ConfigError for what an entry cannot say."""
    look = Look()
    for group, value in kind.items():
        if group in APPEARANCES:
            look = _changed(look, group, value)
    return look


def check_looks(values: Mapping[str, Iterable[str]]) -> None:
    """ConfigError, with group and value, for one that looks like nothing."""
    for group, some in values.items():
        for value in some:
            look_of(Kind(**{group: value}))


def _changed(look: Look, group: str, value: str) -> Look:
    where = f"appearance of {group}: {value}"
    try:
        changed = APPEARANCES[group](look, value)
    except PaError as error:
        raise ConfigError(f"{where}: {error}") from error
    except Exception as error:  # whatever code of others raises
        why = f"{type(error).__name__}: {error}"
        raise ConfigError(f"{where}: expected a Look, got {why}") from error
    if not isinstance(changed, Look):
        raise ConfigError(f"{where}: expected a Look, got {changed!r}")
    return changed
