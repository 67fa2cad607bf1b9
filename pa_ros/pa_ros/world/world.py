"""The world as data: objects, words, joints and relations, from which all sizes follow."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64, Observation
from pa_ros.core.settings import canonical_json, read_json
from pa_ros.language import Goal, Vocabulary, require_possible
from pa_ros.language.syntax import HOLD, NEAR
from pa_ros.world.controller import AXES, HandController
from pa_ros.world.poses import POSE_WIDTH
from pa_ros.world.relation import RELATIONS
from pa_ros.world.schema import ObjectSchema
from pa_ros.world.scoring import Scoring

MAX_JOINTS = 16


@dataclass(frozen=True)
class World:
    """The facts that agents and learner must agree on.

    The vocabulary has the groups of the schema; within a group it may omit words and add spare
    ones.
    """

    schema: ObjectSchema
    vocabulary: Vocabulary
    joints: int
    controller: HandController | None = None  # None: an action is joint velocities
    gripper: bool = False  # whether the hand can hold
    thresholds: tuple[float, ...] = ()  # of the relations; empty: their own

    def __post_init__(self) -> None:
        # The rows of Φ follow the vocabulary and the features follow the schema, so both need one
        # order.
        ours, theirs = [g.name for g in self.schema], list(self.vocabulary.by_group)
        if ours != theirs:
            raise ConfigError(f"world: groups of words: expected {ours}, got {theirs}")
        if type(self.joints) is not int or not 1 <= self.joints <= MAX_JOINTS:
            raise ConfigError(f"world: joints: expected 1 to {MAX_JOINTS}, got {self.joints!r}")
        if self.controller is not None and len(self.controller.joints) != self.joints:
            raise ConfigError(f"world: controller: expected one of {self.joints} joints")
        named = set(self.schema.bodiless) & set(self.vocabulary.words)
        if self.vocabulary.moves_objects and set(self.vocabulary.bodiless) != named:
            raise ConfigError(
                f"world: bodiless words: expected {named}, got {self.vocabulary.bodiless}"
            )
        for relation in self.relations:
            meant = RELATIONS[relation]  # raises ConfigError for an unknown one
            if not self.gripper and (meant.of_grip or relation == HOLD):
                raise ConfigError(
                    f"world: relation {relation}: expected an arm with a gripper: choose a preset "
                    "that has one"
                )

    @property
    def scoring(self) -> Scoring:
        """When its relations hold."""
        return Scoring.of(self.relations, self.thresholds)

    @property
    def nearness(self) -> float:
        """How much farther NEAR reaches than usual: a factor of lengths that are chosen for it."""
        usual = RELATIONS[NEAR].threshold
        return self.scoring.thresholds.get(NEAR, usual) / usual

    @property
    def object_features(self) -> int:
        """Features of an object, F."""
        return self.schema.width

    @property
    def relations(self) -> tuple[str, ...]:
        """Names of the relations that programs may use."""
        return self.vocabulary.relations

    @cached_property
    def sees_hand_pose(self) -> bool:
        """Whether the arm's features end with the hand's pose. Relations in the base's frame need
        it, and programs that move objects, since those stay where they are when the hand moves."""
        return (
            self.gripper
            or self.vocabulary.moves_objects
            or any(RELATIONS[relation].frame == "base" for relation in self.relations)
        )

    @property
    def arm_features(self) -> int:
        """Number of arm features: sin, cos, velocity of each joint; the hand's pose if needed."""
        return 3 * self.joints + (self.hand_features if self.sees_hand_pose else 0)

    @property
    def hand_features(self) -> int:
        """Numbers of `Observation.hand_pose`."""
        return POSE_WIDTH + self.gripper

    def hand_pose(self, arm: Float32) -> Float32:
        """The part of arm features [..., A] that is `Observation.hand_pose`."""
        return arm[..., -self.hand_features :]

    def arm(self, seen: Observation) -> Float32:
        """Arm features [A], float32: sin, cos, velocity (rad/s) of joints, `hand_pose` if used."""
        position, velocity = seen.joint_position, seen.joint_velocity
        parts = [np.sin(position), np.cos(position), velocity]
        parts += [seen.hand_pose] if self.sees_hand_pose else []
        return np.concatenate(parts, dtype=np.float32)

    @property
    def columns(self) -> int:
        """Number of features of ω, a column of Ω: an object's, then the arm's (paper)."""
        return self.object_features + self.arm_features

    @property
    def actions(self) -> int:
        """Elements of an action: one for each joint, or the controller's; the gripper's."""
        return (self.joints if self.controller is None else AXES) + self.gripper

    @property
    def commands(self) -> int:
        """Elements of a command: one for each joint; the gripper's."""
        return self.joints + self.gripper

    def joint_action(self, action: Float32, joint_position: Float64) -> Float32:
        """The command [`commands`] of an action [`actions`], both in [-1, 1]: parts of the joints'
        speed limits; the gripper is on above 0."""
        if self.controller is None:
            return action
        moving = self.controller.joint_action(action[:AXES], joint_position)
        return np.concatenate([moving, action[AXES:]]) if self.gripper else moving

    def action_of(self, command: Float32, joint_position: Float64) -> Float32:
        """The action [`actions`] that best describes a command [`commands`]: the inverse of
        `joint_action`."""
        if self.controller is None:
            return command
        moving = self.controller.action_of(command[: self.joints], joint_position)
        return np.concatenate([moving, command[self.joints :]])

    @cached_property
    def value_words(self) -> Float32:
        """[values, V]: 1 where a value has that word, else 0; values of all groups in order."""
        rows = [
            [
                word == value and word in self.vocabulary[group.name]
                for word in self.vocabulary.words
            ]
            for group in self.schema
            for value in group.features.values
        ]
        return np.array(rows, np.float32).reshape(-1, len(self.vocabulary.words))

    def truth(self, objects: Float32) -> Float32:
        """True properties [..., N, V] of objects [..., N, F]: 1 where a word is true, else 0.

        This is privileged information, for the verifier, relabeling and the distilled critic.
        Spare words are true of no object. ConfigError if features tell no words (schema.Seen).
        """
        if not self.schema.tells_words:
            raise ConfigError("truth: expected properties that are told, got ones that are seen")
        return self.told(objects)

    def require_possible(self, goal: Goal, objects: Float32, hand_index: int) -> None:
        """Raise ProgramError if objects [N, F] tell that a goal cannot hold (`require_possible`).

        Objects that are seen don't tell what they are.
        """
        if self.schema.tells_words:
            words = [name.split() for name in self.schema.labels(objects, hand_index)]
            require_possible(goal, words, hand_index, self.vocabulary.bodiless)

    def told(self, objects: Float32) -> Float32:
        """Words [..., N, V] that the features of objects [..., N, F] tell: 1 where a word is true.

        Of objects that are seen they tell none.
        """
        has = np.concatenate(self.schema.has(objects), -1)
        words: Float32 = has.astype(np.float32) @ self.value_words
        return words

    def to_data(self) -> dict[str, Any]:
        """The same as data for JSON."""
        data = {
            **self.vocabulary.to_data(),
            "objects": self.schema.to_data(),
            "joints": self.joints,
        }
        if self.controller is not None:
            data["controller"] = self.controller.to_data()
        if self.thresholds:
            data["thresholds"] = list(self.thresholds)
        return {**data, "gripper": True} if self.gripper else data

    @classmethod
    def from_data(cls, data: Any) -> World:
        """The inverse of `to_data`; ConfigError for other input."""
        try:
            vocabulary = Vocabulary.of(**{name: tuple(words) for name, words in data["words"]})
            asked = vocabulary.asking(*data["relations"])
            schema = ObjectSchema.from_data(data["objects"])
            if data.get("moves_objects", False) is True:
                asked = asked.moving(*(w for w in asked.words if w in schema.bodiless))
            if data.get("avoids", False) is True:
                asked = asked.avoiding()
            controller = data.get("controller")
            if controller is not None:
                controller = HandController.from_data(controller)
            gripper = data.get("gripper", False) is True
            thresholds = tuple(map(float, data.get("thresholds", ())))
            return cls(schema, asked, data["joints"], controller, gripper, thresholds)
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            raise ConfigError(
                f"world: expected its JSON: {error!r}, got {str(data)[:200]}"
            ) from error

    def to_json(self) -> str:
        """Canonical JSON."""
        return canonical_json(self.to_data())

    @classmethod
    def from_json(cls, text: str) -> World:
        """The inverse of `to_json`; ConfigError for other input."""
        try:
            return cls.from_data(read_json(text))
        except ValueError as error:
            raise ConfigError(f"world: expected JSON: {error}: got {text[:200]!r}") from error

    def __hash__(self) -> int:
        return hash(self.digest)

    @cached_property
    def digest(self) -> str:
        """16 hexadecimal digits, the same for equal worlds only."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:16]
