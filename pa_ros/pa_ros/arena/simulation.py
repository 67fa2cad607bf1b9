"""The simulated world of arm, table and blocks, without programs and rewards."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from math import copysign, cos, sin
from typing import Any

import mujoco
import numpy as np

from pa_ros.arena.appearance import Look
from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import ArenaConfig
from pa_ros.arena.episodes import Block, Episode
from pa_ros.arena.errors import ArenaError, PhysicsError
from pa_ros.arena.gripper import Cup
from pa_ros.arena.model import build
from pa_ros.core.experience import Float32, Float64
from pa_ros.world.relation import BLOCK_M
from pa_ros.world.schema import PAPER, ObjectSchema

HAND_INDEX = 0  # row of the hand in Ω

# The relative orientation conj(h) b is a product with a matrix made of h: entry [in wxyz, out xyzw]
# is _SIGN · h[_ENTRY].
_ENTRY = np.array([[1, 2, 3, 0], [0, 3, 2, 1], [3, 0, 1, 2], [2, 1, 0, 3]])
_SIGN = np.array(
    [[-1.0, -1.0, -1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, 1.0]]
)

# MuJoCo would write warnings to a file in the current folder; `advance` reads them from the state.
mujoco.set_mju_user_warning(lambda _text: None)


class Simulation:
    """The physics of one arena. `place` starts an episode, `advance` runs one control period."""

    def __init__(self, config: ArenaConfig, schema: ObjectSchema = PAPER) -> None:
        self.config, self._schema = config, schema
        self._joints = config.joints
        self._substeps = config.substeps
        # Keyed by the looks of the blocks. Not a method, which would keep the simulation alive.
        self._models = lru_cache(maxsize=128)(partial(_build, config))
        self._placed = False
        self.way: list[Float64] | None = None
        """If it is a list, the hand's position after each physics step is added to it."""

    def place(self, episode: Episode) -> None:
        """Start an episode: the arm at rest in its start pose, the blocks at rest."""
        looks = [self._look(block) for block in episode.blocks]
        self.model, self.data = self._models(tuple(look.solid for look in looks))
        free = iter(self.model.qpos0[self._joints :].reshape(-1, 7))
        for i, (block, look) in enumerate(zip(episode.blocks, looks, strict=True)):
            place = block.x, block.y, look.rest_height + block.above_m
            turn = cos(block.yaw / 2), 0.0, 0.0, sin(block.yaw / 2)
            if look.has_body:
                # The start of a sleeping block must be in qpos0: MuJoCo resets to it and puts the
                # block to sleep there.
                pose = next(free)
                pose[:3], pose[3:] = place, turn
            else:
                body = self.model.body(f"block{i}")
                body.pos[:], body.quat[:] = place, turn
            # Models are shared by all blocks of the same form, so the color is set for each
            # episode.
            rgba = np.array(look.rgba.split(), dtype=np.float32)
            self.model.geom_rgba[self.model.geom(f"block{i}").id] = rgba
        mujoco.mj_resetData(self.model, self.data)  # also puts the blocks to sleep
        self.data.qpos[: self._joints] = episode.arm_start
        self._template = _template(self._schema, episode.blocks)
        self._view_arrays(len(episode.blocks))
        mujoco.mj_kinematics(self.model, self.data)
        if episode.held is not None and self.cup:
            self._start_held(episode.held)
        self._placed = True

    def _start_held(self, index: int) -> None:
        """Put block `index` under the cup, which holds it."""
        assert self.cup is not None
        down = self._rotation[:, 2] * (self.cup.reach_m + BLOCK_M / 2)
        yaw = self._quaternion[1 + index].copy()
        self.put(index, self._position[HAND_INDEX] + down, yaw)
        mujoco.mj_kinematics(self.model, self.data)
        self.cup.take()

    def __deepcopy__(self, memo: dict[int, Any]) -> Simulation:
        """A copy in the same state that shares no arrays with this one."""
        other = memo[id(self)] = type(self)(self.config, self._schema)
        if hasattr(self, "data"):
            other.model, other.data = copy.copy(self.model), copy.copy(self.data)
            other._template = self._template.copy()  # noqa: SLF001 - same class
            other._view_arrays(len(self._position) - 1)  # noqa: SLF001 - same class
            other._placed = self._placed  # noqa: SLF001 - same class
        return other

    def body_states(self) -> tuple[Float64, Float64]:
        """Poses [N, 7] (m, quaternion wxyz) and twists [N, 6] (m/s, rad/s) of hand and blocks, in
        the table's frame."""
        poses = np.hstack([self._position, self._quaternion])
        twists, twist = np.zeros((len(poses), 6)), np.zeros(6)
        for row in range(len(poses)):
            what = mujoco.mjtObj.mjOBJ_BODY
            mujoco.mj_objectVelocity(self.model, self.data, what, self._hand + row, twist, 0)
            # MuJoCo gives rotation first.
            twists[row] = np.roll(twist, 3)
        return poses, twists

    def rearrange(self, episode: Episode, poses: Float64, twists: Float64) -> None:
        """Replace the blocks by those of `episode`, at poses [n, 7] with twists [n, 6] as in
        `body_states`; the arm keeps its state."""
        arm = self.joint_position, self.joint_velocity
        self.place(episode)
        joints = len(arm[0])
        self.data.qpos[:joints], self.data.qvel[:joints] = arm
        bodies = [self._schema.has_body(block.kind) for block in episode.blocks]
        poses, twists = poses[bodies], twists[bodies]  # a place is where `place` put it
        resting = self.model.qpos0[joints:].reshape(-1, 7)
        moving = ~np.isclose(poses, resting, atol=1e-6).all(1) | twists.any(1)
        for i in np.flatnonzero(moving):  # the other blocks stay asleep
            # MuJoCo wants the angular velocity of a free joint in the frame of the block.
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, poses[i, 3:])
            spin = turn.reshape(3, 3).T @ twists[i, 3:]
            self.data.qpos[joints + 7 * i : joints + 7 * (i + 1)] = poses[i]
            self.data.qvel[joints + 6 * i : joints + 6 * (i + 1)] = *twists[i, :3], *spin
        mujoco.mj_forward(self.model, self.data)

    def put(self, index: int, position: Float64, quaternion: Float64) -> None:
        """Put block or place `index` (from 0) at a pose in the table's frame (m, wxyz), at rest."""
        body = self.model.body(f"block{index}")
        if body.jntnum[0]:
            start = self.model.jnt_qposadr[body.jntadr[0]]
            pose = self.data.qpos[start : start + 7]
            pose[:3], pose[3:] = position, quaternion
        else:
            self.data.mocap_pos[body.mocapid[0]] = position
            self.data.mocap_quat[body.mocapid[0]] = quaternion

    def advance(self, command: Float64) -> None:
        """Command joint velocities, rad/s [J], and the gripper (on above 0) for one control period.

        They must be finite and within the limits; the caller checks that. Raises ArenaError
        (arena.episode) without an episode, PhysicsError if the physics fails.
        """
        if not self._placed:
            raise ArenaError("expected a reset before the first command", code="arena.episode")
        cup = self.cup
        self._control[:] = command if cup is None else command[: self._joints]
        if cup is not None:
            cup.switch(command[-1] > 0)
        if self.way is None:
            mujoco.mj_step(self.model, self.data, self._substeps)
        else:
            for _ in range(self._substeps):
                mujoco.mj_step(self.model, self.data, 1)
                mujoco.mj_kinematics(self.model, self.data)
                self.way.append(self._position[HAND_INDEX].copy())
        # MuJoCo only warns, and after a bad state it restarts the episode by itself.
        if np.count_nonzero(self._warnings):
            self._placed = False
            kind = mujoco.mjtWarning(int(self._warnings.argmax())).name
            raise PhysicsError(f"the physics of this episode is void: MuJoCo warns of {kind}")
        mujoco.mj_kinematics(self.model, self.data)  # mj_step leaves the poses before the step
        if cup is not None and command[-1] > 0:
            cup.take()

    def objects(self) -> Float32:
        """Object features [N, F], the hand's first, with poses in the hand's frame."""
        objects = self._template.copy()
        position, quaternion = self._position, self._quaternion
        # Of matrices this small, `dot` takes half the time of `@`.
        objects[1:, :3] = (position[1:] - position[0]).dot(self._rotation)
        relative = quaternion[1:].dot(quaternion[0][_ENTRY] * _SIGN)  # [n, 4] xyzw
        objects[1:, 3:7] = relative * np.copysign(1.0, relative[:, 3:])  # qw >= 0
        return objects

    @property
    def joint_position(self) -> Float64:
        """Joint positions [J], rad; a copy."""
        return self._arm_position.copy()

    @property
    def joint_velocity(self) -> Float64:
        """Joint velocities [J], rad/s; a copy."""
        return self._arm_velocity.copy()

    @property
    def positions(self) -> Float64:
        """Positions of hand and blocks in the table's frame, [N, 3] m; a copy."""
        return self._position.copy()

    @property
    def link_positions(self) -> Float64:
        """Positions of joints and hand in the table's frame, [J + 1, 3] m."""
        return np.vstack([self.data.xanchor[: self._joints], self._position[:1]])

    @property
    def hand_pose(self) -> Float64:
        """Pose of the hand in the frame of the table, whose origin is the arm's base: x y z (m),
        quaternion xyzw with qw >= 0, [7]; with a gripper, whether it holds a block, [8]."""
        # Plain numbers take a third of the time of arrays.
        w, x, y, z = self._quaternion[HAND_INDEX].tolist()
        sign = copysign(1.0, w)
        place = self._position[HAND_INDEX].tolist()
        pose = [*place, sign * x, sign * y, sign * z, sign * w]
        if self.cup is not None:
            pose.append(float(self.cup.holds))
        return np.array(pose)

    def hand_jacobian(self) -> Float64:
        """Jacobian of the hand's position in the table's frame, [3, J] m/rad."""
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jacBody(self.model, self.data, jacobian, None, self._hand)
        return jacobian[:, : self._joints]

    def _look(self, block: Block) -> Look:
        return replace(block.look, has_body=self._schema.has_body(block.kind))

    def _view_arrays(self, blocks: int) -> None:
        """Keep views of MuJoCo's arrays, because reading an attribute of MjData is slow."""
        self._hand = self.model.body("hand").id
        rows = slice(self._hand, self._hand + 1 + blocks)
        self._position: Float64 = self.data.xpos[rows]
        self._quaternion: Float64 = self.data.xquat[rows]
        self._rotation = self.data.xmat[self._hand].reshape(3, 3)
        self._warnings, self._control = self.data.warning.number, self.data.ctrl
        gripper = ARMS[self.config.arm].gripper if self.config.gripper else None
        self.cup = None if gripper is None else Cup(gripper, self.model, self.data)
        arm = slice(self._joints)
        self._arm_position: Float64 = self.data.qpos[arm]
        self._arm_velocity: Float64 = self.data.qvel[arm]


def _build(config: ArenaConfig, looks: tuple[Look, ...]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = build(config, looks)
    return model, mujoco.MjData(model)


def _template(schema: ObjectSchema, blocks: Sequence[Block]) -> Float32:
    """The features that stay the same in an episode: properties, and the row of the hand."""
    hand = np.zeros(schema.width, dtype=np.float32)
    hand[6] = 1.0  # identity quaternion
    return np.stack([hand, *(block.features(schema) for block in blocks)])
