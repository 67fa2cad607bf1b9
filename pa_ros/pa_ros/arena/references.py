"""Reference policies: a scripted controller with privileged information, and random actions."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, copysign, hypot, pi

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.task import ReachTask
from pa_ros.core.experience import Float64
from pa_ros.world.relation import RELATIONS

Policy = Callable[[ReachTask], Float64]

DAMPING = 0.02  # of the least squares; m/rad
SLACK_RAD = 0.02  # a joint this close to its limit is not moved further


def scripted_action(task: ReachTask) -> Float64:
    """Joint velocities (rad/s, [J]) toward a place where the program is satisfied. Privileged."""
    return pursue(task, nearest_target(task))


def nearest_target(task: ReachTask) -> Float64:
    """Center of the named block nearest to the hand, [3] m in the table's frame."""
    positions = task.simulation.positions  # [N, 3]
    hand = positions[0]
    return min(
        (positions[i] for i in task.verifier.targets),
        key=lambda place: float(np.linalg.norm(place - hand)),
    )


def pursue(task: ReachTask, target: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) that bring the hand into the program's relation to `target`
    ([3] m in the table's frame)."""
    relation = task.program.relation
    hand, threshold = task.simulation.positions[0], task.scoring.threshold(relation)
    return toward(task, RELATIONS[relation].goal(hand, target, threshold))


def toward(task: ReachTask, goal: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) toward `goal` ([3] m in the table's frame).

    Damped least squares on the hand's Jacobian in cylindrical coordinates (radius, azimuth,
    height), so that the base turns toward a target behind the arm, in the direction that its range
    allows. The base turns at its own limit; the other joints are slowed down together.
    """
    simulation = task.simulation
    hand = simulation.positions[0]
    error = _cylindrical_error(task, hand, goal)
    jacobian = _cylindrical_jacobian(hand, simulation.hand_jacobian())
    # As if the hand had to arrive within one step; `_limited` then slows it down to what the arm
    # can do.
    rates = error / task.config.control_period_s
    for _ in range(2):  # the second time without the joints at their limits
        velocity = _damped_least_squares(jacobian, rates)
        jacobian = jacobian * _free(task, velocity)
    return _limited(velocity, np.array(task.config.joint_speed_limits))


def random_policy(seed: int) -> Policy:
    """Uniform joint velocities within the limits, from a separate random stream."""
    rng = np.random.default_rng([seed, 3])

    def act(task: ReachTask) -> Float64:
        return np.array(task.config.joint_speed_limits) * rng.uniform(-1.0, 1.0, task.config.joints)

    return act


def reward_per_step(
    task: ReachTask, policy: Policy, episode_index: int, condition: str = "train"
) -> float:
    """Mean reward per step of one episode."""
    _, verdict = task.reset(episode_index, condition)
    total, steps = 0.0, 0
    while not verdict.truncated:
        _, verdict = task.step(policy(task))
        total, steps = total + verdict.reward, steps + 1
    return total / steps


def mean_reward(task: ReachTask, policy: Policy, episodes: int, condition: str = "train") -> float:
    """Mean reward per step over episodes 0 … episodes - 1."""
    return float(np.mean([reward_per_step(task, policy, i, condition) for i in range(episodes)]))


def _cylindrical_error(task: ReachTask, hand: Float64, goal: Float64) -> Float64:
    """Goal minus hand: radius (m), azimuth (rad, as the base can turn), height (m)."""
    turn = atan2(goal[1], goal[0]) - atan2(hand[1], hand[0])
    turn = (turn + pi) % (2 * pi) - pi  # the shorter direction
    if not _turns_freely(task):
        low, high = task.config.joint_lower[0], task.config.joint_upper[0]
        # A base with limits may have to turn the long way round.
        other = turn - copysign(2 * pi, turn)
        base = task.simulation.joint_position[0]
        if not low <= base + turn <= high and low <= base + other <= high:
            turn = other
    return np.array([hypot(*goal[:2]) - hypot(*hand[:2]), turn, goal[2] - hand[2]])


def _turns_freely(task: ReachTask) -> bool:
    return ARMS[task.config.arm].joints[0].limits is None


def _cylindrical_jacobian(hand: Float64, jacobian: Float64) -> Float64:
    """The Jacobian with rows for radius, azimuth and height instead of x, y, z: [3, J]."""
    # Near the base axis the azimuth is not defined.
    radius = max(hypot(*hand[:2]), 0.05)
    x, y = hand[:2] / radius
    frame = np.array([[x, y, 0.0], [-y / radius, x / radius, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(frame @ jacobian)


def _damped_least_squares(jacobian: Float64, rates: Float64) -> Float64:
    gram = jacobian @ jacobian.T + DAMPING**2 * np.eye(3)
    return np.asarray(jacobian.T @ np.linalg.solve(gram, rates))


def _free(task: ReachTask, velocity: Float64) -> Float64:
    """1 for joints that can move as `velocity` says, 0 for joints at a limit."""
    position = task.simulation.joint_position
    up = (velocity > 0) & (position > np.array(task.config.joint_upper) - SLACK_RAD)
    down = (velocity < 0) & (position < np.array(task.config.joint_lower) + SLACK_RAD)
    free = (~(up | down)).astype(np.float64)
    if _turns_freely(task):
        free[0] = 1.0
    return free


def _limited(velocity: Float64, limits: Float64) -> Float64:
    excess = float(np.max(np.abs(velocity[1:]) / limits[1:], initial=0.0))
    limited = velocity.copy()
    # Slow the joints down together, so that the hand keeps its direction.
    limited[1:] /= max(excess, 1.0)
    return np.clip(limited, -limits, limits)
