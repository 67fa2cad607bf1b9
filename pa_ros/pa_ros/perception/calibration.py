"""Calibration: features of one size from the looks of blobs, and a threshold for novel looks.

Made once, from pictures of scenes with known blocks; nobody says which block is which. It travels
with a checkpoint as text, and its digest is part of the world, so that agents, learner and camera
agree on it.
"""

from __future__ import annotations

import hashlib
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.core.settings import canonical_json, read_json
from pa_ros.perception.blobs import Blob
from pa_ros.perception.errors import PerceptionError
from pa_ros.perception.looks import CHANNELS, NEEDS_ALL
from pa_ros.world.schema import ObjectSchema, PropertyGroup, Seen

FORMAT = 2  # of the text, and of the numbers that `looks` and `blobs` compute
FEATURES = 12  # of a channel, at most; also the principal components that tell what is novel
NORM = 4.0  # root mean square of a channel's features, in network units
FARTHEST = 4.0  # standard deviations
LEAST_SPREAD = 2e-3  # numbers that vary less say nothing
FEWEST, MOST = 40, 300  # blobs that a calibration is made from
USUAL = 0.99  # share of known blobs whose nearest neighbour is not farther than usual
MARGINS = {"shape": 1.4, "color": 6.0}  # times as far as usual is novel


@dataclass(frozen=True, eq=False)
class Channel:
    """Maps the D numbers of a look to W features: z-scores, projected; zero for novel looks.

    Novelty is measured between the numbers themselves. Z-scores would enlarge the noise of pixels
    that scarcely differ between known blobs.
    """

    mean: Float32  # [D]
    rate: Float32  # [D], 1 / standard deviation; 0: not used
    axes: Float32  # [W, D]
    parts: Float32  # [P, D], principal components of the numbers
    known: Float32  # [K, P + 1], blobs of the calibration: along each, and what is left over
    novel: Float32  # []: farther than this from all that is known

    @classmethod
    def of(cls, looks: Float64, margin: float) -> Channel:
        """Fit a channel to looks [K, D] of known blobs. Novel is what is farther from them than
        `margin` times the usual distance of two neighbours."""
        mean, spread = looks.mean(0), looks.std(0)
        rate = np.where(spread > LEAST_SPREAD, 1 / np.maximum(spread, LEAST_SPREAD), 0.0)
        scores = _scores(looks, mean, rate)
        axes = np.eye(looks.shape[1])
        if len(axes) > FEATURES:  # principal components, each with variance 1
            sizes, axes = _components(scores)
            axes = axes * (len(looks) ** 0.5 / sizes[:, None])
        features = np.clip(scores @ axes.T, -FARTHEST, FARTHEST)
        axes = axes * (NORM / np.sqrt((features**2).sum(1).mean()))
        _, parts = _components(looks - mean)
        known = _along(parts, looks - mean)
        apart = np.linalg.norm(known[:, None] - known[None], axis=-1)
        novel = margin * np.quantile(_nearest_other(apart), USUAL)
        arrays = mean, rate, axes, parts, known, novel
        return cls(*(np.array(array, np.float32) for array in arrays))

    def __call__(self, look: Float64) -> Float32:
        """The features of a look [D], [W]; zero if it is novel, as if nothing had been seen."""
        where = _along(self.parts, look - self.mean)
        if np.linalg.norm(self.known - where, axis=-1).min() > self.novel:
            return np.zeros(self.width, np.float32)
        features = _scores(look, self.mean, self.rate) @ np.float64(self.axes).T
        return features.astype(np.float32)

    @property
    def width(self) -> int:
        """Number of features, W."""
        return len(self.axes)


def _scores(looks: Float64, mean: Any, rate: Any) -> Float64:
    return np.asarray(np.clip((looks - mean) * rate, -FARTHEST, FARTHEST))


def _components(numbers: Float64) -> tuple[Float64, Float64]:
    """Singular values [P] and directions [P, D] of the principal components of numbers [K, D]."""
    _, sizes, directions = np.linalg.svd(numbers, full_matrices=False)
    return sizes[:FEATURES], directions[:FEATURES]


def _along(parts: Any, numbers: Any) -> Float64:
    """Numbers [..., D] along each part, and the length of what is left over: [..., P + 1]."""
    along = numbers @ parts.T
    rest = np.linalg.norm(numbers - along @ parts, axis=-1, keepdims=True)
    return np.concatenate([along, rest], axis=-1)


def _nearest_other(apart: Float64) -> Float64:
    return np.asarray(np.min(apart + np.diag(np.full(len(apart), np.inf)), axis=1))


@dataclass(frozen=True, eq=False)
class Calibration:
    """How one camera of one arena sees: a channel for each property group."""

    view: str
    width: int  # of pictures, px
    height: int
    channels: dict[str, Channel]

    @classmethod
    def of(cls, view: str, size: tuple[int, int], blobs: Sequence[Blob]) -> Calibration:
        """Fit to uncovered blobs of known blocks. PerceptionError if they are too few."""
        if len(blobs) < FEWEST:
            raise PerceptionError(
                f"calibration: expected at least {FEWEST} blobs, found {len(blobs)}: does camera "
                f"{view!r} see the table?",
                code="perception.calibration",
            )
        channels = {}
        for name, look in CHANNELS.items():
            looks = np.stack([look(blob) for blob in blobs[:MOST]])
            channels[name] = Channel.of(looks, MARGINS[name])
        return cls(view, *size, channels)

    def to_text(self) -> str:
        """The same as one line of JSON."""
        channels = {
            name: {f.name: _to_data(getattr(channel, f.name)) for f in fields(channel)}
            for name, channel in self.channels.items()
        }
        size = {"width": self.width, "height": self.height}
        return canonical_json({"format": FORMAT, "view": self.view, **size, "channels": channels})

    @classmethod
    def from_text(cls, text: str) -> Calibration:
        """The inverse of `to_text`; PerceptionError for other text."""
        try:
            data = dict(read_json(text))
            if data.pop("format") != FORMAT:
                raise ValueError(f"expected format {FORMAT}")
            channels = {
                name: _channel({k: _from_data(x) for k, x in parts.items()})
                for name, parts in data.pop("channels").items()
            }
            if set(channels) != set(CHANNELS):
                raise ValueError(f"expected channels {list(CHANNELS)}")
            return cls(**data, channels={name: channels[name] for name in CHANNELS})
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise PerceptionError(
                f"calibration: expected what a training run wrote: {error!r}, got {text[:80]!r}",
                code="perception.calibration",
            ) from error


@dataclass(frozen=True, eq=False)
class Cameras:
    """The calibrated cameras that an agent sees through; the first sees best where blocks are."""

    each: tuple[Calibration, ...]

    def features(self, looks: Mapping[int, Blob]) -> Float32:
        """The properties of an object, from the look that each camera had at it, in the order of
        the schema's columns; zero where a camera did not see it, or not enough of it."""
        found = []
        for name, look in CHANNELS.items():
            for number, camera in enumerate(self.each):
                channel, blob = camera.channels[name], looks.get(number)
                if blob is None or (blob.covered and name in NEEDS_ALL):
                    found.append(np.zeros(channel.width, np.float32))
                else:
                    found.append(channel(look(blob)))
        # The norm is that of one camera's features.
        return np.concatenate(found) / np.float32(len(self.each) ** 0.5)

    @property
    def widths(self) -> dict[str, int]:
        """Number of features of each property group."""
        return {name: sum(one.channels[name].width for one in self.each) for name in CHANNELS}

    def schema(self, told: ObjectSchema) -> ObjectSchema:
        """The schema of what is seen in place of one in which properties are told.

        Objects without a body are not seen: they stay told. ConfigError unless it has the groups
        that cameras see.
        """
        if [group.name for group in told] != list(CHANNELS):
            raise ConfigError(
                f"perception: expected a design with the property groups {list(CHANNELS)}, got "
                f"{[group.name for group in told]}"
            )
        groups = []
        for group in told:
            # Of its other properties an object without a body may have any value.
            values = group.bodiless or (group.features.values if told.bodiless else ())
            seen = Seen(self.widths[group.name], calibration=self.digest, told=values)
            groups.append(PropertyGroup(group.name, group.words, seen, group.bodiless))
        return ObjectSchema(tuple(groups))

    @cached_property
    def digest(self) -> str:
        """16 hexadecimal digits, the same for equal calibrations only."""
        return hashlib.sha256(self.to_text().encode()).hexdigest()[:16]

    def to_text(self) -> str:
        """One line for each camera."""
        return "\n".join(one.to_text() for one in self.each)

    @classmethod
    def from_text(cls, text: str) -> Cameras:
        """The inverse of `to_text`; PerceptionError for other text."""
        return cls(tuple(map(Calibration.from_text, text.split("\n"))))


def _channel(parts: dict[str, Float32]) -> Channel:
    channel = Channel(**parts)
    channel(np.zeros(len(channel.mean)))  # a ValueError unless the arrays fit each other
    if not all(np.isfinite(x).all() for x in parts.values()) or not channel.novel > 0:
        raise ValueError("expected finite numbers and a positive threshold")
    return channel


def _to_data(array: Float32) -> dict[str, Any]:
    return {"shape": list(array.shape), "float32": b64encode(array.tobytes()).decode()}


def _from_data(data: dict[str, Any]) -> Float32:
    numbers = np.frombuffer(b64decode(data["float32"], validate=True), "<f4")
    return numbers.reshape(data["shape"]).astype(np.float32)
