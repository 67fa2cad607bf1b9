"""Reference policies: a script with privileged information, and random actions."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, copysign, hypot, pi

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.kinematics import hand_controller
from pa_ros.arena.task import ReachTask, play
from pa_ros.core.experience import Float64
from pa_ros.language.syntax import NEAR, Program
from pa_ros.world.relation import RELATIONS

Policy = Callable[[ReachTask], Float64]

DAMPING = 0.02  # of the least squares; m/rad
SLACK_RAD = 0.02  # a joint this close to its limit is not moved further


def scripted_action(task: ReachTask) -> Float64:
    """Joint velocities (rad/s, [J]) toward a place where the program is satisfied. Privileged."""
    return task.design.skill.script(task)


def nearest_target(task: ReachTask) -> Float64:
    """Center of the named object nearest to what is to be moved, [3] m in the table's frame."""
    return np.asarray(task.simulation.positions[nearest_pair(task)[1]])


def nearest_pair(task: ReachTask) -> tuple[int, int]:
    """The nearest two objects of which one is to be moved, the hand for example, to the other; if
    possible to one that need not be avoided."""
    positions, program = task.simulation.positions, task.program  # [N, 3]
    targets = {*task.verifier.targets}
    if program.avoided is not None:
        targets = targets - {*task.verifier_of(Program(program.avoided)).targets} or targets
    pairs = ((i, j) for i in task.verifier.moved for j in sorted(targets) if i != j)
    return min(pairs, key=lambda pair: float(np.linalg.norm(np.subtract(*positions[[*pair]]))))


# How the script pushes a block; lengths in m, speeds in m/s.
PUSH_HEIGHT = 0.085  # of the hand while it pushes
TRAVEL_HEIGHT = 0.17  # of the hand while it passes over blocks
BEHIND = 0.095  # from the block's center to the hand's, before it pushes
ON_LINE = 0.035  # the hand pushes if it is this close to the line from the block to its place
ARRIVED, TOUCHING = 0.02, 0.065  # from the center of a place, of a block
PUSH_SPEED, TRAVEL_SPEED = 0.25, 0.5


def push(task: ReachTask, moved: int, target: int) -> Float64:
    """Joint velocities (rad/s, [J]) that push one object to where the relation to another holds:
    over it at height, down behind it, and along the line to where it should be."""
    positions, relation = task.simulation.positions, RELATIONS[task.program.relation]
    hand, block, place = positions[0], positions[moved], positions[target]
    if target == 0:
        return toward(task, block + np.array([0.0, 0.0, PUSH_HEIGHT]))
    if relation.name != NEAR:
        place = relation.goal(block, place, task.scoring.threshold(relation.name, between=True))
    way, offset = (place - block)[:2], (hand - block)[:2]
    distance, solid = float(np.hypot(*way)), relation.name == NEAR and _is_solid(task, target)
    if distance < (TOUCHING if solid else ARRIVED):
        return np.zeros(task.config.joints)
    along = way / distance
    across = np.array([-along[1], along[0]])
    behind, aside = float(offset @ along), float(offset @ across)
    start = np.array([*block[:2] - along * BEHIND, PUSH_HEIGHT])
    if hand[2] < 0.11 and behind < -0.05 and abs(aside) < ON_LINE:
        flat = along * min(PUSH_SPEED, 6.0 * distance + 0.02) - across * 4.0 * aside
        return _hand_velocity(task, np.array([*flat, _rates(task, start - hand)[2]]))
    if np.hypot(*(hand - start)[:2]) < ARRIVED:
        return _hand_velocity(task, _rates(task, start - hand))
    error = _cylindrical_error(task, hand, np.array([*start[:2], TRAVEL_HEIGHT]))
    if hand[2] < 0.13 and np.hypot(*offset) < 0.14:
        error[:2] = 0.0  # first up, so that it does not push the block aside
    return _travel(task, hand, error)


def pointing_down(task: ReachTask, place: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) that bring the hand to `place` ([3] m in the table's frame),
    pointing down."""
    hand = task.simulation.positions[0]
    return _travel(task, hand, _cylindrical_error(task, hand, place))


def _travel(task: ReachTask, hand: Float64, error: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) that remove a cylindrical error, pointing down."""
    radius = hypot(*hand[:2])
    x, y = hand[:2] / radius
    out, left, up = _rates(task, error * (1.0, radius, 1.0))
    return _hand_velocity(task, np.array([x * out - y * left, y * out + x * left, up]))


def _is_solid(task: ReachTask, index: int) -> bool:
    return task.design.schema.has_body(task.episode.blocks[index - 1].kind)


def _rates(task: ReachTask, error: Float64) -> Float64:
    """Velocities [3] (m/s) that remove an error (m) in one control period, or as fast as the hand
    travels."""
    rates = error / task.config.control_period_s
    rates[:2] /= max(1.0, float(np.abs(rates[:2]).max()) / TRAVEL_SPEED)
    rates[2] = np.clip(rates[2], -TRAVEL_SPEED, TRAVEL_SPEED)
    return np.asarray(rates)


def _hand_velocity(task: ReachTask, velocity: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) for the hand's velocity [3] (m/s), pointing down."""
    controller, joints = hand_controller(task.config), task.simulation.joint_position
    found = controller.solve(velocity, controller.hand(joints), joints)
    return found / max(1.0, float(np.max(np.abs(found) / controller.speed_limits)))


# How the script comes near a block but not near others, which are at least
# `ArenaConfig.block_separation_m` from it: high over them, and no lower than it must. Lengths in m.
CLEAR_HEIGHT, OVER_TARGET, HIGH_ENOUGH, OVER_IT = 0.30, 0.14, 0.24, 0.06


def from_above(task: ReachTask, target: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) that bring the hand over `target` ([3] m in the table's frame),
    at a height at which it is near no other block."""
    hand = task.simulation.positions[0]
    if np.hypot(*(target - hand)[:2]) < OVER_IT:
        return toward(task, target + np.array([0.0, 0.0, OVER_TARGET]))
    place = target if hand[2] > HIGH_ENOUGH else hand
    return toward(task, np.array([*place[:2], CLEAR_HEIGHT]))


def reach(task: ReachTask, target: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) that satisfy the program at `target` ([3] m in the table's
    frame), and keep the hand away from what the program avoids."""
    if task.program.avoided is not None and task.program.relation == NEAR:
        return from_above(task, target)
    return pursue(task, target)


def pursue(task: ReachTask, target: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) that bring the hand into the program's relation to `target`
    ([3] m in the table's frame)."""
    relation = task.program.relation
    hand, threshold = task.simulation.positions[0], task.scoring.threshold(relation)
    return toward(task, RELATIONS[relation].goal(hand, target, threshold))


def toward(task: ReachTask, place: Float64) -> Float64:
    """Joint velocities (rad/s, [J]) toward `place` ([3] m in the table's frame); a gripper is off.

    Damped least squares on the hand's Jacobian in cylindrical coordinates (radius, azimuth,
    height), so that the base turns toward a target behind the arm, in the direction that its range
    allows. The base turns at its own limit; the other joints are slowed down together.
    """
    simulation = task.simulation
    hand = simulation.positions[0]
    error = _cylindrical_error(task, hand, place)
    jacobian = _cylindrical_jacobian(hand, simulation.hand_jacobian())
    # As if the hand had to arrive within one step; `_limited` then slows it down to what the arm
    # can do.
    rates = error / task.config.control_period_s
    for _ in range(2):  # the second time without the joints at their limits
        velocity = _damped_least_squares(jacobian, rates)
        jacobian = jacobian * _free(task, velocity)
    limited = _limited(velocity, np.array(task.config.joint_speed_limits))
    return np.append(limited, -1.0) if task.config.gripper else limited


def random_policy(seed: int) -> Policy:
    """Uniform commands within the limits, from a separate random stream."""
    rng = np.random.default_rng([seed, 3])

    def act(task: ReachTask) -> Float64:
        limits = np.array(task.config.command_limits)
        return limits * rng.uniform(-1.0, 1.0, len(limits))

    return act


def reward_per_step(
    task: ReachTask, policy: Policy, episode_index: int, condition: str = "train"
) -> float:
    """Mean reward per step of one episode."""
    steps = play(task, lambda _: policy(task), task.reset(episode_index, condition))
    _, *rewards = [verdict.reward for _, verdict in steps]  # a reset rewards no action
    return sum(rewards) / len(rewards)


def mean_reward(task: ReachTask, policy: Policy, episodes: int, condition: str = "train") -> float:
    """Mean reward per step over episodes 0 … episodes - 1."""
    return float(np.mean([reward_per_step(task, policy, i, condition) for i in range(episodes)]))


def _cylindrical_error(task: ReachTask, hand: Float64, place: Float64) -> Float64:
    """Place minus hand: radius (m), azimuth (rad, as the base can turn), height (m)."""
    turn = atan2(place[1], place[0]) - atan2(hand[1], hand[0])
    turn = (turn + pi) % (2 * pi) - pi  # the shorter direction
    if not _turns_freely(task):
        low, high = task.config.joint_lower[0], task.config.joint_upper[0]
        # A base with limits may have to turn the long way round.
        other = turn - copysign(2 * pi, turn)
        base = task.simulation.joint_position[0]
        if not low <= base + turn <= high and low <= base + other <= high:
            turn = other
    return np.array([hypot(*place[:2]) - hypot(*hand[:2]), turn, place[2] - hand[2]])


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
