"""Moving, adding and removing blocks during an episode."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import atan2, hypot

import numpy as np

from pa_ros.arena.designs import Kind
from pa_ros.arena.episodes import Block
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.model import TABLE_SIDE_M
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Body

REACH_M = TABLE_SIDE_M / 2  # greatest coordinate of a block, from the middle of the table
# Greatest speeds of a block that somebody moves. MuJoCo gives up at very large ones.
LARGEST_M_S, LARGEST_RAD_S = 10.0, 100.0
APART_M = 0.05  # least distance between the centers of two blocks


def _scene_error(message: str) -> ArenaError:
    return ArenaError(message, code="arena.scene")


def bodies(task: ReachTask) -> list[Body]:
    """The bodies of hand and blocks, in the order of object features."""
    poses, twists = task.simulation.body_states()
    return [
        Body(pose[:3], np.roll(pose[3:], -1), twist[:3], twist[3:])
        for pose, twist in zip(poses, twists, strict=True)
    ]


def rearrange(
    task: ReachTask, kinds: Sequence[Kind], blocks: Sequence[Body], given: Collection[int] = ()
) -> None:
    """Replace the blocks by these, with their poses and velocities; the arm keeps its state.

    The program stays, even if it names nothing for a while. Raises ArenaError (arena.scene), and
    changes nothing, if a given pose is impossible or if no block is left.

    :param given: indices of the blocks whose poses somebody chose. The others may be anywhere: a
        block may have been thrown off the table, or lie against another.
    """
    if not kinds:
        raise _scene_error("blocks: expected at least one to stay, got none")
    placed = list(blocks)
    for body in placed:
        numbers = np.concatenate([body.position, body.quaternion, body.linear, body.angular])
        if not np.isfinite(numbers).all():
            raise _scene_error(f"pose, twist: expected finite numbers, got {numbers.tolist()}")
    for i in given:
        _check(placed[i])
    solid = [task.design.schema.has_body(kind) for kind in kinds]
    edges = {block.kind: block.edge_m for block in task.episode.blocks}
    resting = [_resting(kind, body, edges.get(kind, 0.0))
               for kind, body in zip(kinds, placed, strict=True)]  # fmt: skip
    for i in given:
        placed[i] = _lifted(resting[i], blocks[i])
        others = [body for j, body in enumerate(placed) if solid[i] and solid[j] and j != i]
        gaps = [float(np.linalg.norm(placed[i].position - other.position)) for other in others]
        if gaps and min(gaps) < APART_M:
            text = f"expected at least {APART_M} m to every other block, got {min(gaps):.3f} m"
            raise _scene_error(f"pose: {text}")
    episode = replace(task.episode, blocks=tuple(resting))
    poses = np.array([[*body.position, *np.roll(body.quaternion, 1)] for body in placed])
    twists = np.array([[*body.linear, *body.angular] for body in placed])
    task.rearrange(episode, poses, twists)


def _check(body: Body) -> None:
    """Raise ArenaError for an impossible pose or velocity."""
    if abs(hypot(*body.quaternion) - 1.0) > 1e-3:
        raise _scene_error(f"pose: expected a unit quaternion, got {body.quaternion.tolist()}")
    if (np.abs(body.position) > REACH_M).any():
        raise _scene_error(
            f"pose: expected a position within {REACH_M} m of the table's middle, "
            f"got {body.position.tolist()}"
        )
    speed, spin = np.abs(body.linear).max(), np.abs(body.angular).max()
    if speed > LARGEST_M_S or spin > LARGEST_RAD_S:
        most = f"{LARGEST_M_S:g} m/s and {LARGEST_RAD_S:g} rad/s along an axis"
        raise _scene_error(f"twist: expected at most {most}, got {speed:g} and {spin:g}")


def _lifted(block: Block, body: Body) -> Body:
    """The body, raised to where it rests if it is lower."""
    position = body.position.copy()
    # A block inside the table would be thrown out by the contact force.
    position[2] = max(position[2], block.look.rest_height)
    return replace(body, position=position)


def _resting(kind: Kind, body: Body, edge_m: float) -> Block:
    """The place and yaw at which the body would rest."""
    x, y, z, w = body.quaternion
    yaw = atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return Block(kind, float(body.position[0]), float(body.position[1]), yaw, edge_m)
