"""Faults of a real arm in the arena, drawn anew for each episode, so that an agent that was trained
with them moves a real arm as well: commands come late or are lost, poses are noisy or lost."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import Float32, Float64
from pa_ros.world.poses import POSE_WIDTH, in_base, in_hand

STREAM = 4  # of default_rng([seed, stream, episode])
LATE = 0.5  # share of the episodes in which commands act a control period later
NOISE_M, NOISE_RAD = 0.005, float(np.deg2rad(2.0))  # of each measured pose of an object
LOST, LOST_S = 0.02, 1.0  # chance in a second that an object is lost, and for how long
DROPPED = 0.02  # share of commands, and of each object's poses, that do not arrive


class Faults:
    """The faults of one episode."""

    def __init__(self, seed: int, episode: int, period_s: float) -> None:
        self._rng = np.random.default_rng([seed, STREAM, episode])
        self._is_late = bool(self._rng.random() < LATE)
        self._arrived: Float64 | None = None  # the newest command that the arm received
        self._lost, self._lost_steps = LOST * period_s, round(LOST_S / period_s)
        self.forget()

    def forget(self) -> None:
        """There are other objects from now on."""
        self._kept = np.empty((0, POSE_WIDTH))  # poses measured last, in the base's frame
        self._missing = np.empty(0, int)  # steps until each object is found again

    def command(self, sent: Float64) -> Float64:
        """What the arm does in the control period that begins when a command is sent."""
        before = np.zeros_like(sent) if self._arrived is None else self._arrived
        self._arrived = before if self._rng.random() < DROPPED else sent
        return before if self._is_late else self._arrived

    def measured(self, objects: Float32, hand: Float64) -> Float32:
        """True features of objects [N, F], the hand's first, as they are measured: an object that
        is lost keeps the pose that it had. `hand`: its pose, [7] or more; call once a step."""
        hand, rng, count = hand[:POSE_WIDTH], self._rng, len(objects) - 1
        poses = in_base(hand, objects[1:, :POSE_WIDTH].astype(np.float64))
        poses[:, :3] += rng.normal(0, NOISE_M, (count, 3))
        poses[:, 3:6] += rng.normal(0, NOISE_RAD / 2, (count, 3))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        if len(self._kept) != count:
            self._kept, self._missing = poses.copy(), np.zeros(count, int)
        vanish, dropped = rng.random((2, count))
        gone = np.where(vanish < self._lost, self._lost_steps, self._missing - 1)
        self._missing = np.maximum(gone, 0)
        arrives = (self._missing == 0) & (dropped >= DROPPED)
        self._kept[arrives] = poses[arrives]
        seen = objects.copy()
        seen[1:, :POSE_WIDTH] = in_hand(hand, self._kept)
        return seen
