"""A world: all that sizes, words and meanings follow from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation
from pa_ros.core.settings import canonical_json, read_json
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.world.relations import RELATIONS
from pa_ros.world.relations.frames import POSE
from pa_ros.world.schema import MAX_WORDS, ObjectSchema

MAX_JOINTS = 16


@dataclass(frozen=True)
class World:
    """What agents and learner have to agree on: objects, words, joints, relations.

    The vocabulary has the schema's groups, with all their words, fewer, or other spare ones.
    """

    schema: ObjectSchema
    vocabulary: Vocabulary
    joints: int

    def __post_init__(self) -> None:
        ours, theirs = [g.name for g in self.schema], list(self.vocabulary.by_group)
        if ours != theirs:
            raise ConfigError(f"world: groups of words: expected {ours}, got {theirs}")
        words = len(self.vocabulary.words)
        if words > MAX_WORDS:
            raise ConfigError(f"world: words: expected 1 to {MAX_WORDS}, got {words}")
        if type(self.joints) is not int or not 1 <= self.joints <= MAX_JOINTS:
            raise ConfigError(f"world: joints: expected 1 to {MAX_JOINTS}, got {self.joints!r}")
        for relation in self.relations:
            RELATIONS[relation]

    @property
    def object_features(self) -> int:
        """Features of an object, F."""
        return self.schema.width

    @property
    def relations(self) -> tuple[str, ...]:
        """Names of those that programs may ask for; ConfigError refuses what is not registered."""
        return self.vocabulary.relations

    @cached_property
    def sees_hand_pose(self) -> bool:
        """Whether the arm's features end with the hand's pose: some relation is of the base's
        frame."""
        return any(RELATIONS[relation].frame == "base" for relation in self.relations)

    @property
    def arm_features(self) -> int:
        """Features of the arm: sin, cos and velocity of each joint, and maybe the hand's pose."""
        return 3 * self.joints + (POSE if self.sees_hand_pose else 0)

    def arm(self, seen: Observation) -> Float32:
        """Arm part of Ω, [A] float32: sin and cos (of rad), velocity (rad/s), `hand_pose` maybe."""
        position, velocity = seen.joint_position, seen.joint_velocity
        parts = [np.sin(position), np.cos(position), velocity]
        parts += [seen.hand_pose] if self.sees_hand_pose else []
        return np.concatenate(parts).astype(np.float32)

    @property
    def columns(self) -> int:
        """Features of ω, a column of Ω: an object's, then the arm's (paper, appendix)."""
        return self.object_features + self.arm_features

    @property
    def actions(self) -> int:
        """Elements of an action: one for each joint."""
        return self.joints

    @cached_property
    def value_words(self) -> Float32:
        """[values, V]: 1 where a value, of all groups in order, has that word, else 0."""
        rows = [
            [
                word == value and word in self.vocabulary[group.name]
                for word in self.vocabulary.words
            ]
            for group in self.schema
            for value in group.features.values
        ]
        return np.array(rows, np.float32)

    def truth(self, objects: Float32) -> Float32:
        """True properties [..., N, V] of objects [..., N, F]: 1 where a word is true, else 0.

        Privileged: of the verifier, relabeling and the distilled critic. Words that are no value
        are true of nothing.
        """
        has = np.concatenate(self.schema.has(objects), -1)
        truth: Float32 = has.astype(np.float32) @ self.value_words
        return truth

    def to_data(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "objects": self.schema.to_data(),
            "words": [[group.name, list(group.words)] for group in self.vocabulary.groups],
            "joints": self.joints,
            "relations": list(self.relations),
        }

    @classmethod
    def from_data(cls, data: Any) -> World:
        """The inverse of `to_data`; ConfigError if it isn't."""
        try:
            vocabulary = Vocabulary.of(**{name: tuple(words) for name, words in data["words"]})
            asked = vocabulary.asking(*data["relations"])
            return cls(ObjectSchema.from_data(data["objects"]), asked, data["joints"])
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            raise ConfigError(
                f"world: expected its JSON: {error!r}, got {str(data)[:200]}"
            ) from error

    def to_json(self) -> str:
        """Canonical JSON."""
        return canonical_json(self.to_data())

    @classmethod
    def from_json(cls, text: str) -> World:
        """The inverse of `to_json`; ConfigError if it isn't."""
        try:
            return cls.from_data(read_json(text))
        except ValueError as error:
            raise ConfigError(f"world: expected JSON: {error}: got {text[:200]!r}") from error

    def __hash__(self) -> int:
        return hash(self.digest)

    @cached_property
    def digest(self) -> str:
        """16 hexadecimal digits that equal worlds share and different ones do not."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:16]
