"""The simulated world: arm, table and blocks. Knows nothing of programs and rewards."""

from __future__ import annotations

import copy
from functools import lru_cache, partial
from math import copysign, cos, sin
from typing import Any, NoReturn

import mujoco
import numpy as np

from pa_ros.arena.appearance import Look, look_of
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.designs import Kind
from pa_ros.arena.episodes import Episode
from pa_ros.arena.errors import CommandError, DivergedError, EpisodeError
from pa_ros.arena.features import HAND_INDEX, object_features, template
from pa_ros.arena.model import build
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Float64
from pa_ros.world.schema import PAPER, ObjectSchema

_World = tuple[mujoco.MjModel, mujoco.MjData]


class Simulation:
    """One arena. `place` puts an episode on the table, `advance` runs one control period."""

    def __init__(self, config: ArenaConfig, schema: ObjectSchema = PAPER) -> None:
        self.config, self._schema = config, schema
        self._joints = config.joints
        self._limits, self._substeps = np.array(config.joint_speed_limits), config.substeps
        self._world = lru_cache(maxsize=128)(partial(_built, config))  # by the blocks' looks
        self._placed = False

    def place(self, episode: Episode) -> None:
        """Start anew: the arm in its start pose and at rest, blocks resting where they belong."""
        if not episode.blocks:
            raise EpisodeError(f"episode {episode.index}: expected at least one block, got none")
        looks = [look_of(block.kind) for block in episode.blocks]
        self.model, self.data = self._world(tuple(look.solid for look in looks))
        for i, (block, look) in enumerate(zip(episode.blocks, looks, strict=True)):
            pose = self.model.qpos0[self._joints + 7 * i : self._joints + 7 * (i + 1)]
            pose[:3] = block.x, block.y, look.rest_height
            pose[3:] = cos(block.yaw / 2), 0.0, 0.0, sin(block.yaw / 2)
            rgba = np.array(look.rgba.split(), dtype=np.float32)
            self.model.geom_rgba[self.model.geom(f"block{i}").id] = rgba
        mujoco.mj_resetData(self.model, self.data)  # puts the blocks to sleep where they are
        self.data.qpos[: self._joints] = episode.arm_start
        self._template = template(self._schema, [block.kind for block in episode.blocks])
        self._view_arrays(len(episode.blocks))
        mujoco.mj_kinematics(self.model, self.data)
        self._placed = True

    def __deepcopy__(self, memo: dict[int, Any]) -> Simulation:
        """In the same state, with a model, arrays and views of its own."""
        other = memo[id(self)] = type(self)(self.config, self._schema)
        if hasattr(self, "data"):
            other.model, other.data = copy.copy(self.model), copy.copy(self.data)
            other._template = self._template.copy()  # noqa: SLF001 - its own kind
            other._view_arrays(len(self._position) - 1)  # noqa: SLF001 - its own kind
            other._placed = self._placed  # noqa: SLF001 - its own kind
        return other

    def __reduce__(self) -> NoReturn:
        raise ConfigError("simulation: expected copy.deepcopy, or to be made anew, got a pickler")

    def rest_height(self, kind: Kind) -> float:
        """Of the center of a block that lies on the table, m."""
        return look_of(kind).rest_height

    def body_states(self) -> tuple[Float64, Float64]:
        """Of hand and blocks in the table's frame: poses [N, 7] (m, quaternion wxyz), and twists
        [N, 6] (m/s, rad/s)."""
        poses = np.hstack([self._position, self._quaternion])
        twists, twist = np.zeros((len(poses), 6)), np.zeros(6)
        for row in range(len(poses)):
            what = mujoco.mjtObj.mjOBJ_BODY
            mujoco.mj_objectVelocity(self.model, self.data, what, self._hand + row, twist, 0)
            twists[row] = np.roll(twist, 3)  # MuJoCo gives rotation first
        return poses, twists

    def rearrange(self, episode: Episode, poses: Float64, twists: Float64) -> None:
        """Place an episode's blocks at these poses, [n, 7], with these twists, [n, 6], as
        `body_states` gives them; the arm goes on from where it is."""
        arm = self.joint_position, self.joint_velocity
        self.place(episode)
        joints = len(arm[0])
        self.data.qpos[:joints], self.data.qvel[:joints] = arm
        resting = self.model.qpos0[joints:].reshape(-1, 7)
        moving = ~np.isclose(poses, resting, atol=1e-6).all(1) | twists.any(1)
        for i in np.flatnonzero(moving):  # the others stay asleep
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, poses[i, 3:])
            spin = turn.reshape(3, 3).T @ twists[i, 3:]  # a free joint's is about its own axes
            self.data.qpos[joints + 7 * i : joints + 7 * (i + 1)] = poses[i]
            self.data.qvel[joints + 6 * i : joints + 6 * (i + 1)] = *twists[i, :3], *spin
        mujoco.mj_forward(self.model, self.data)

    def advance(self, joint_velocity: Float64) -> None:
        """Command joint velocities, rad/s [J], for one control period.

        They must be finite and within the limits: `checked`, or the node's own check, sees to it.
        """
        self._control[:] = joint_velocity
        mujoco.mj_step(self.model, self.data, self._substeps)
        if self._warnings.any():  # MuJoCo itself goes on, from the start if all blew up
            self._placed = False
            kind = mujoco.mjtWarning(int(self._warnings.argmax())).name
            raise DivergedError(f"the physics of this episode is void: MuJoCo warns of {kind}")
        mujoco.mj_kinematics(self.model, self.data)  # poses of the new positions

    def checked(self, joint_velocity: Float64) -> Float64:
        """The command as float64 [J], clamped to the speed limits.

        Raises CommandError if it is mis-sized or not finite, EpisodeError before the first `place`.
        """
        if not self._placed:
            raise EpisodeError("expected an episode to be placed before the first command")
        try:
            command = np.asarray(joint_velocity, dtype=np.float64)
        except (TypeError, ValueError) as error:
            received = repr(joint_velocity)[:80]
            raise CommandError(f"joint command: expected numbers, got {received}") from error
        if command.shape != (self._joints,):
            raise CommandError(
                f"joint command: expected shape ({self._joints},), got {command.shape}"
            )
        if not np.isfinite(command).all():
            raise CommandError(f"joint command: expected finite rad/s, got {command.tolist()}")
        clamped: Float64 = np.clip(command, -self._limits, self._limits)
        return clamped

    def objects(self) -> Float32:
        """Ω without the arm: [N, F], hand first, in the hand's frame."""
        return object_features(self._template, self._position, self._quaternion, self._rotation)

    @property
    def joint_position(self) -> Float64:
        """[J] rad, a copy."""
        return np.array(self._arm_position)

    @property
    def joint_velocity(self) -> Float64:
        """[J] rad/s, a copy."""
        return np.array(self._arm_velocity)

    @property
    def positions(self) -> Float64:
        """Hand and blocks in the table's frame, [N, 3] m, a copy."""
        return np.array(self._position)

    @property
    def link_positions(self) -> Float64:
        """The arm's joints and the hand in the table's frame, [J + 1, 3] m."""
        return np.vstack([self.data.xanchor[: self._joints], self._position[:1]])

    @property
    def hand_pose(self) -> Float64:
        """Of the hand in the table's frame, where the base stands at 0: x y z (m), quaternion xyzw
        with qw >= 0, [7]."""
        w, x, y, z = self._quaternion[HAND_INDEX].tolist()  # plain numbers: a third of the time
        sign = copysign(1.0, w)
        place = self._position[HAND_INDEX].tolist()
        return np.array([*place, sign * x, sign * y, sign * z, sign * w])

    def hand_jacobian(self) -> Float64:
        """Of the hand's position in the table's frame with respect to the joints, [3, J] m/rad."""
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jacBody(self.model, self.data, jacobian, None, self._hand)
        return jacobian[:, : self._joints]

    def _view_arrays(self, blocks: int) -> None:
        """Views into MuJoCo's arrays: reading an attribute of MjData costs as much as using it."""
        self._hand = self.model.body("hand").id
        rows = slice(self._hand, self._hand + 1 + blocks)
        self._position, self._quaternion = self.data.xpos[rows], self.data.xquat[rows]
        self._rotation = self.data.xmat[self._hand]
        self._warnings, self._control = self.data.warning.number, self.data.ctrl
        arm = slice(self._joints)
        self._arm_position, self._arm_velocity = self.data.qpos[arm], self.data.qvel[arm]


def _built(config: ArenaConfig, looks: tuple[Look, ...]) -> _World:
    """Not a method: a cache of one would hold the simulation, and all its models, in a circle."""
    model = build(config, looks)
    return model, mujoco.MjData(model)
