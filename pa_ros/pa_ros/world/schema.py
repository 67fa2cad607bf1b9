"""The features of an object in an observation: its pose, then any number of property groups."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from math import dist, inf, isfinite
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32
from pa_ros.language.syntax import SIZE
from pa_ros.language.vocabulary import Vocabulary, WordGroup

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Metres, then the orientation, both in the frame of the hand; qw >= 0."""
MAX_SEEN = 240  # features of a group


@dataclass(frozen=True)
class OneHot:
    """One feature for each value. Words of the group that are not values are spare."""

    values: tuple[str, ...]
    tolerance: ClassVar[float] = 0.5  # half of 1; two one-hot vectors are √2 apart
    scale: ClassVar[float] = 1.0  # network units per unit of the features

    def names(self, group: str) -> tuple[str, ...]:
        """Feature names, in column order."""
        return tuple(f"{group}_{value.lower()}" for value in self.values)

    @cached_property
    def prototypes(self) -> dict[str, tuple[float, ...]]:
        """The features of an object of each value."""
        rows = np.eye(len(self.values)).tolist()
        return {value: tuple(row) for value, row in zip(self.values, rows, strict=True)}

    def to_data(self) -> dict[str, Any]:
        """The same as data for JSON."""
        return {"values": list(self.values)}


@dataclass(frozen=True)
class Real:
    """One or more numbers, such as a size in m, an RGB color or an embedding.

    `of` contains the numbers of each value. A word is true of an object whose numbers are within
    `tolerance` of its value. Networks get the raw numbers, times `scale`.
    """

    features: tuple[str, ...]
    of: Mapping[str, tuple[float, ...]] = field(hash=False)
    tolerance: float
    scale: float = 1.0

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the values."""
        return tuple(self.of)

    def names(self, group: str) -> tuple[str, ...]:
        """Feature names, in column order."""
        return tuple(f"{group}_{feature}" for feature in self.features)

    @property
    def prototypes(self) -> dict[str, tuple[float, ...]]:
        """The features of an object of each value."""
        return {value: tuple(map(float, numbers)) for value, numbers in self.of.items()}

    def to_data(self) -> dict[str, Any]:
        """The same as data for JSON."""
        return {
            "features": list(self.features),
            "of": [[value, list(numbers)] for value, numbers in self.prototypes.items()],
            "tolerance": float(self.tolerance),
            "scale": float(self.scale),
        }


@dataclass(frozen=True)
class Seen:
    """Numbers that a sensor, such as a camera, measures of an object. They don't say which words
    are true of it: networks must learn that, and only the verifier knows the truth.

    Objects without a body are not seen. One more feature for each value that they may have says
    what they are, and their seen features are zero. For all other objects these features are zero.
    """

    width: int  # number of features that are seen
    scale: float = 1.0  # network units per unit of the features
    calibration: str = ""  # digest of what turns the sensor's data into the features
    told: tuple[str, ...] = ()  # values of objects that are told

    tolerance: ClassVar[float] = 0.5  # as of OneHot

    def __post_init__(self) -> None:
        if type(self.width) is not int or not 1 <= self.width <= MAX_SEEN:
            raise ConfigError(f"seen features: width: expected 1 to {MAX_SEEN}, got {self.width!r}")

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the values that are told."""
        return self.told

    @property
    def prototypes(self) -> dict[str, tuple[float, ...]]:
        """The features of an object of each value that is told."""
        one_hot = OneHot(self.told).prototypes
        return {value: (0.0,) * self.width + row for value, row in one_hot.items()}

    def names(self, group: str) -> tuple[str, ...]:
        """Feature names, in column order."""
        seen = tuple(f"{group}_{i}" for i in range(self.width))
        return seen + OneHot(self.told).names(group)

    def to_data(self) -> dict[str, Any]:
        """The same as data for JSON."""
        told = {"told": list(self.told)} if self.told else {}
        return {"seen": self.width, "scale": float(self.scale), "calibration": self.calibration,
                **told}  # fmt: skip


@dataclass(frozen=True)
class PropertyGroup:
    """Values of which each object has exactly one, their words, and their features."""

    name: str
    words: tuple[str, ...]  # may include spare words, for values that do not exist yet
    features: OneHot | Real | Seen
    bodiless: tuple[str, ...] = ()  # values of objects that the arm can neither touch nor move

    def __post_init__(self) -> None:
        WordGroup(self.name, self.words)
        prototypes, tolerance = self.features.prototypes, self.features.tolerance
        width = len(self.features.names(self.name))
        if unknown := set(self.bodiless) - set(prototypes):
            raise ConfigError(f"{self}: bodiless: expected some of its values, got {unknown}")
        if not isinstance(self.features, Seen) and not (prototypes and width):
            raise ConfigError(f"{self}: expected at least one value and one feature, got none")
        for value, numbers in prototypes.items():
            if len(numbers) != width or not all(map(isfinite, numbers)):
                raise ConfigError(
                    f"{self}: {value}: expected {width} finite numbers, got {numbers}"
                )
        if not (0 < tolerance < inf and 0 < self.features.scale < inf):
            raise ConfigError(
                f"{self}: expected a positive tolerance and scale, got {tolerance} and "
                f"{self.features.scale}"
            )
        # Values must be more than two tolerances apart, so that at most one word of a group is
        # true.
        for (one, here), (other, there) in combinations(prototypes.items(), 2):
            if dist(here, there) <= 2 * tolerance:
                raise ConfigError(
                    f"{self}: expected values more than twice the tolerance {tolerance} apart, got "
                    f"{one} {here} and {other} {there}"
                )

    def __str__(self) -> str:
        return f"property group {self.name}"


@dataclass(frozen=True)
class ObjectSchema:
    """Groups of properties in the order of their features and words."""

    groups: tuple[PropertyGroup, ...]

    def __post_init__(self) -> None:
        if not self.groups:
            raise ConfigError("object schema: expected at least one property group, got none")
        if len(set(self.feature_names)) < self.width:
            raise ConfigError(
                f"object schema: expected different features, got {list(self.feature_names)}"
            )

    def __iter__(self) -> Iterator[PropertyGroup]:
        return iter(self.groups)

    def __getitem__(self, name: str) -> PropertyGroup:
        """A group by name; ConfigError lists the known groups."""
        for group in self.groups:
            if group.name == name:
                return group
        raise ConfigError(
            f"unknown property group: expected one of {[g.name for g in self]}, got {name!r}"
        )

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """The words of all groups."""
        return Vocabulary(tuple(WordGroup(group.name, group.words) for group in self))

    @cached_property
    def feature_names(self) -> tuple[str, ...]:
        """Feature names, in column order: x y z qx qy qz qw shape_cube …"""
        return POSE + tuple(name for group in self for name in group.features.names(group.name))

    @cached_property
    def bodiless(self) -> frozenset[str]:
        """Values of objects without a body, which are seen and named but cannot be moved."""
        return frozenset(value for group in self for value in group.bodiless)

    def has_body(self, values: Mapping[str, str]) -> bool:
        """Whether an object with these values has a body."""
        return self.bodiless.isdisjoint(values.values())

    def bodies(self, objects: Float32) -> NDArray[np.bool_]:
        """Which objects [..., F] have a body, the hand included: [...]."""
        body = np.ones(objects.shape[:-1], np.bool_)
        for group, has in zip(self, self.has(objects), strict=True):
            body &= ~has[..., [value in group.bodiless for value in group.features.values]].any(-1)
        return body

    @property
    def width(self) -> int:
        """Number of features of an object, F."""
        return len(self.feature_names)

    @property
    def properties(self) -> slice:
        """The columns of all groups."""
        return slice(len(POSE), self.width)

    @cached_property
    def slices(self) -> dict[str, slice]:
        """The columns of each group."""
        slices, start = {}, len(POSE)
        for group in self:
            stop = start + len(group.features.names(group.name))
            slices[group.name], start = slice(start, stop), stop
        return slices

    @cached_property
    def prototypes(self) -> tuple[Float32, ...]:
        """The features of each value, by group: [values, features of the group]."""
        return tuple(
            np.array([*g.features.prototypes.values()], np.float32).reshape(
                -1, len(g.features.names(g.name))
            )
            for g in self
        )

    @cached_property
    def seen_columns(self) -> NDArray[np.intp]:
        """The columns of what is seen, of all groups in order."""
        parts = [
            np.arange(self.slices[g.name].start, self.slices[g.name].start + g.features.width)
            for g in self
            if isinstance(g.features, Seen)
        ]
        return np.concatenate([np.zeros(0, np.intp), *parts])

    @property
    def tells_words(self) -> bool:
        """Whether features say which words are true of an object."""
        return not any(isinstance(group.features, Seen) for group in self)

    def features(self, values: Mapping[str, str]) -> Float32:
        """Features of an object with these values, its pose zero: [F].

        ConfigError for an unknown group or value, or a group without a value.
        """
        row = np.zeros(self.width, np.float32)
        for name in (*values, *self.slices):
            known = self[name].features.prototypes
            value = values.get(name, "")
            if value not in known:
                raise ConfigError(
                    f"{self[name]}: expected a value of {sorted(known)}, got {value!r}"
                )
            row[self.slices[name]] = known[value]
        return row

    def has(self, objects: Any, prototypes: Any = None) -> list[Any]:
        """Whether objects [..., F] have each value: bool [..., values] for each group.

        Objects may be torch tensors if `prototypes` are torch tensors too.
        """
        return [
            within(objects[..., self.slices[group.name]], known, group.features.tolerance)
            for group, known in zip(self, prototypes or self.prototypes, strict=True)
        ]

    def labels(self, objects: Float32, hand_index: int) -> tuple[str, ...]:
        """A name for each object [N, F]: "hand", "RED CUBE", or "block 3" without known values."""
        names = []
        for i, row in enumerate(objects):
            known = [
                value.upper()
                for group, has in zip(self, self.has(row), strict=True)
                for value, is_so in zip(group.features.values, has, strict=True)
                if is_so
            ]
            names.append("hand" if i == hand_index else " ".join(known[::-1]) or f"block {i}")
        return tuple(names)

    @property
    def scales(self) -> Float32:
        """Network units per unit of each feature, [F]; 1 for the pose."""
        scales = np.ones(self.width, np.float32)
        for group in self:
            scales[self.slices[group.name]] = group.features.scale
        return scales

    def to_data(self) -> list[dict[str, Any]]:
        """The same as data for JSON."""
        return [
            {"name": g.name, "words": list(g.words), **g.features.to_data()}
            | ({"bodiless": list(g.bodiless)} if g.bodiless else {})
            for g in self
        ]

    @classmethod
    def from_data(cls, data: Any) -> ObjectSchema:
        """The inverse of `to_data`; ConfigError for other data."""
        try:
            return cls(tuple(_group(dict(one)) for one in data))
        except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
            raise ConfigError(
                f"object schema: expected groups of properties as JSON: {error!r}, "
                f"got {str(data)[:200]}"
            ) from error


def within(features: Any, prototypes: Any, tolerance: float) -> Any:
    """Whether features [..., W] are within the tolerance of prototypes [P, W]: [..., P]."""
    return ((features[..., None, :] - prototypes) ** 2).sum(-1) <= tolerance**2


def _group(data: dict[str, Any]) -> PropertyGroup:
    name, words = data.pop("name"), tuple(data.pop("words"))
    bodiless = tuple(data.pop("bodiless", ()))
    if "seen" in data:
        told = tuple(data.pop("told", ()))
        return PropertyGroup(name, words, Seen(data.pop("seen"), told=told, **data), bodiless)
    if "values" in data:
        return PropertyGroup(name, words, OneHot(tuple(data.pop("values")), **data), bodiless)
    numbers = {value: tuple(row) for value, row in data.pop("of")}
    features = Real(tuple(data.pop("features")), numbers, **data)
    return PropertyGroup(name, words, features, bodiless)


SHAPES = ("CUBE", "SPHERE", "CYLINDER", "CAPSULE")
COLORS = ("RED", "GREEN", "BLUE", "YELLOW", "MAGENTA")
PAPER = ObjectSchema(
    (
        PropertyGroup("shape", SHAPES, OneHot(SHAPES)),
        PropertyGroup("color", COLORS, OneHot(COLORS)),
    )
)
"""Shapes and colors of the paper's blocks, and one more of each."""

MIDDLE_EDGE_M = 0.06
SIZED = ObjectSchema(
    (
        *PAPER.groups,
        PropertyGroup(
            SIZE,
            ("SMALL", "LARGE"),
            Real(
                ("m_from_middle",),
                {"SMALL": (-0.02,), "LARGE": (0.02,)},
                tolerance=0.0199,
                scale=50.0,
            ),
        ),
    )
)
"""The same with a size, a number: how much longer an edge is than MIDDLE_EDGE_M. Every edge of 2.1
to 5.9 cm is SMALL, and of 6.1 to 9.9 cm LARGE. Networks get 50 units per metre, so that the
prototypes are -1 and 1, and 0 is neither."""

PLACE = "PLACE"
PUSHING = ObjectSchema(
    (
        PropertyGroup("shape", (*SHAPES, PLACE), OneHot((*SHAPES, PLACE)), bodiless=(PLACE,)),
        PropertyGroup("color", COLORS, OneHot(COLORS)),
    )
)
"""The same with places: colored disks on the table, which blocks can be moved to."""
