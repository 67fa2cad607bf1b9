"""An arm of the arena as data, and its poses in which the hand points down."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import atan2, hypot

import mujoco
import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.config import ArenaConfig, Joints
from pa_ros.arena.model import build
from pa_ros.core.errors import ConfigError
from pa_ros.world.controller import Frame, HandController

POSE_TRIES = 200  # steps of the search for a pose
DIGITS = 12  # of the numbers in the controller's data, which are the same on every machine


@lru_cache(maxsize=16)
def hand_controller(config: ArenaConfig) -> HandController:
    """The controller of the arena's arm; ConfigError if a joint is not at its body's origin."""
    model, joints = build(config, ()), ARMS[config.arm].joints
    links: list[Frame] = []
    body = model.body("hand").id
    while body:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_quat[body])
        frame = model.body_pos[body].round(DIGITS).tolist(), turn.round(DIGITS).tolist()
        position, rotation = map(tuple, frame)
        if (index := int(model.body_jntadr[body])) < 0:
            links.append(Frame(position, rotation, None))
        else:
            joint, speed = joints[index], config.joint_speed_limits[index]
            if model.jnt_pos[index].any() or model.jnt_axis[index].tolist() != [0.0, 0.0, 1.0]:
                raise ConfigError(f"arm {config.arm}: {joint.name}: expected its body's z axis")
            zero, free = float(model.qpos0[index]), joint.limits is None
            links.append(
                Frame(position, rotation, zero, joint.lower, joint.upper, free, float(speed))
            )
        body = int(model.body_parentid[body])
    arm, period_s = ARMS[config.arm], config.control_period_s
    space = arm.hand_radii_m, arm.hand_heights_m
    known = HandController(tuple(links[::-1]), config.hand_speed, period_s, 0.0, *space)
    start = known.hand([joint.start for joint in joints])
    return replace(known, heading=round(start.heading, DIGITS))


def joints_at(config: ArenaConfig, x: float, y: float, z: float) -> Joints:
    """Joint positions with the hand at a place in the base's frame (m), pointing down."""
    radius, azimuth = hypot(x, y), atan2(y, x)
    joints, reached, direction = _joints_at(config, round(radius, 2), round(z, 3))
    turn = (azimuth - reached) * direction
    first = ARMS[config.arm].joints[0]
    base = (joints[0] + turn + np.pi) % (2 * np.pi) - np.pi
    if first.limits is not None:
        base = float(np.clip(base, first.lower, first.upper))
    return base, *joints[1:]


@lru_cache(maxsize=512)
def _joints_at(config: ArenaConfig, radius: float, z: float) -> tuple[Joints, float, int]:
    """A pose with the hand at a radius and height, the hand's azimuth in it, and the sign with
    which the first joint turns it."""
    controller = hand_controller(config)
    joints = np.array([joint.start for joint in ARMS[config.arm].joints])
    low, high = np.array(config.joint_lower), np.array(config.joint_upper)
    for _ in range(POSE_TRIES):
        hand = controller.hand(joints)
        place = hand.place
        outward = place[:2] / hypot(*place[:2])
        moving = np.array([*outward * (radius - hypot(*place[:2])), z - place[2]])
        joints = np.clip(joints + controller.solve(moving, hand, joints) * 0.5, low, high)
    place, _, jacobian = controller.hand(joints)
    direction = 1 if place[0] * jacobian[1, 0] > place[1] * jacobian[0, 0] else -1
    return tuple(joints.tolist()), atan2(place[1], place[0]), direction
