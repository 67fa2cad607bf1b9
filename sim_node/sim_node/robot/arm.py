"""A real arm as agents see an arena: observations, verdicts, and the velocities that it may have.

Without ROS. The caller gives the time of its monotonic clock.
"""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import replace

import mujoco
import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.kinematics import hand_controller
from pa_ros.arena.task import GoalVerifier, scoring_of, world_of
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Float64, Observation, Step
from pa_ros.language import Goal, parse_goal
from pa_ros.language.syntax import HOLD, NEAR
from pa_ros.wire.arena import describe_robot
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.step import Command
from pa_ros.world import reward_from
from pa_ros.world.poses import IDENTITY, in_base, in_hand, objects_from_poses
from pa_ros.world.relation import RELATIONS
from pa_ros.world.velocity import DeadReckoning
from sim_node.robot.frames import FrameTree, Placed
from sim_node.robot.guard import Guard
from sim_node.robot.joints import JointHistory
from sim_node.robot.lessons import Lessons
from sim_node.robot.relay import SILENCE_S
from sim_node.robot.settings import HAND, Robot, pose_of

COMMAND_TIMEOUT_S = 0.3  # without a command the arm holds: three control periods
ARM_TIMEOUT_S = 0.2  # greatest age of the joints and the hand
FOLLOW_STEPS, FOLLOW_RAD = 10, 0.1  # over so many steps, and if it is sent at least so far, …
FOLLOWS = 0.02  # … an arm that moves less than this share does not follow: a person stopped it
FRESH_S = 2.0  # greatest age of the objects with which it continues to learn
AXES = np.hstack([np.eye(3), np.tile(IDENTITY[3:], (3, 1))])  # poses, [3, 7]
TURN_M, DAMPING = 0.2, 1e-3  # how much turning counts beside moving; m²
HAND_M, HAND_RAD = 0.05, 0.2  # greatest differences of the measured hand and the model's


class RealArm:
    """The arm and the objects that robot.yaml describes.

    `frames` and `joints` are what was measured; the caller adds to them.
    """

    def __init__(self, robot: Robot) -> None:
        settings = self.settings = robot.settings
        config, self._design = settings.arena_config(), settings.design_of()
        self.frames, self.joints = FrameTree(), JointHistory(robot.joints)
        self.seen: Observation | None = None  # the newest observation
        self.holds: bool | None = None  # whether the gripper says so; None: not yet
        self.program: str = ""  # canonical text; empty: none yet
        self.oldest_s = 0.0  # since the oldest measurement in the newest observation arrived
        self.measured: dict[str, Float64] = {}  # pose [7] in the base's frame, by object
        self.model = hand_controller(config)
        self._kinds = dict(zip(robot.objects, robot.kinds, strict=True))
        # Names of the objects on the table: where it learns, a person says when they are there.
        self._present = tuple(robot.objects) if settings.learning is None else ()
        hand = settings.hand_frame, pose_of(settings.hand_offset)
        things = {name: (t.source, pose_of(t.offset)) for name, t in robot.objects.items()}
        self._sources = {HAND: hand, **things}  # frame that measures it, and its pose there
        self._scoring = scoring_of(config, self._design, reward_from(settings.reward))
        self._verifier: GoalVerifier | None = None
        self._program_id, self._episode = "", 0
        period_s, self.lessons = config.control_period_s, None
        if settings.learning is not None:
            self.lessons = Lessons(settings.learning, self._design, robot.kinds, period_s)
        # The agent learned that joints stop here, where the real ones may turn on. Only a base may
        # turn without limits.
        limits = [(joint.lower, joint.upper) for joint in ARMS[config.arm].joints]
        self._middle = np.mean(limits, axis=1)
        if ARMS[config.arm].joints[0].limits is None:
            limits[0] = -np.inf, np.inf
        speeds = np.array(config.joint_speed_limits) * settings.speed_scale
        lower, upper = np.array(limits).T
        ramp = settings.max_acceleration
        self._guard = Guard(settings.workspace, lower, upper, speeds, ramp)
        # A trajectory's point is one period ahead, and the arm stays there.
        point = settings.control == "joint_trajectory"
        self.believed = DeadReckoning(
            speeds.tolist(), config.control_period_s if point else SILENCE_S
        )
        # How far the fastest joint moved in each step, and was to move; rad.
        self._moves = deque[tuple[float, float]](maxlen=FOLLOW_STEPS)
        self._joints_before: Float64 | None = None
        self._apart = np.zeros(3)  # m, from the model's hand to the measured one
        self._turned = np.eye(3)  # the rotation between them
        self.about = describe_robot(
            world_of(config, self._design),
            dict(zip(self.joints.names, speeds.tolist(), strict=True)),
            config.control_period_s,
            self._design.name,
            config.preset,
            config.arm,
            limits=limits,
        )
        thresholds, reward = tuple(self._scoring.thresholds.values()), self._scoring.reward
        self.about = replace(self.about, thresholds=thresholds, reward=reward.to_json())
        if self.lessons is not None:
            self.about = replace(
                self.about,
                training_programs=self.lessons.programs,
                episode_steps=self.lessons.episode_steps,
                block_count=self.lessons.blocks,
            )

    # Programs

    def submit(self, request: ProgramRequest) -> str:
        """Put a program in force; its canonical text. Raises ProgramError; nothing changes then."""
        program = parse_goal(request.text, self._design.vocabulary)
        self._verifier = self._verifier_of(program)
        self._program_id, self.program = request.program_id, str(program)
        return self.program

    def _verifier_of(self, goal: Goal) -> GoalVerifier:
        """A goal's verifier. Raises ProgramError, and ArenaError (`robot.box`) for one whose first
        program would need the hand outside its box."""
        kinds = [self._kinds[name] for name in self._present]
        verifier = GoalVerifier(goal, kinds, self._scoring, self._design.schema)
        program, box = verifier.program, self.settings.workspace
        if not program.moves_hand or program.relation != NEAR or program.compares:
            return verifier
        near_m = self._scoring.threshold_of(program)
        targets = [self.measured.get(self._present[i - 1]) for i in verifier.pursued.named]
        places = [pose[:3] for pose in targets if pose is not None]
        away = [float(np.linalg.norm(at - np.clip(at, box.lower, box.upper))) for at in places]
        if len(away) == len(targets) and min(away, default=0.0) > near_m:
            raise ArenaError(
                f"{goal}: the hand would have to leave its box: the nearest such object is "
                f"{min(away):.2f} m outside, and {near_m:.2f} m are near",
                code="robot.box",
            )
        return verifier

    # Learning

    def leave_blocks(self) -> None:
        """A person is about to scatter the blocks: where they are does not count meanwhile."""
        self._present, self._verifier, self.program = (), None, ""

    def take_blocks(self, now_s: float) -> tuple[str, ...]:
        """A person has scattered the blocks: from now on those count that are measured. Raises
        ArenaError (`robot.blocks`) unless it is as many as robot.yaml says; their names."""
        assert self.lessons is not None
        there, oldest = [], min(self.settings.objects_timeout_s, FRESH_S)
        for name in self._kinds:
            with suppress(ArenaError):
                placed = self.frames.pose(self.settings.base_frame, self._sources[name][0])
                there += [name] if now_s - placed.arrived_s <= oldest else []
        if len(there) != self.lessons.blocks:
            raise ArenaError(
                f"expected {self.lessons.blocks} objects on the table, as learning.blocks says, "
                f"got {len(there)}: {', '.join(there) or 'none'} measured in the last {oldest:g} s",
                code="robot.blocks",
            )
        self._present = tuple(there)
        self.lessons.scattered()
        return self._present

    def begin_episode(self, stamp_ns: int) -> Step:
        """The first step of the next episode. It begins where the arm is now, under a training
        program that is not satisfied. Raises ArenaError (`robot.programs`) if no program fits."""
        assert self.lessons is not None and self.seen is not None
        seen = self.seen
        for program in self.lessons.order():
            try:
                verifier = self._verifier_of(program)
            except PaError:  # not with these blocks
                continue
            verdict = verifier.verdict(seen.objects, seen.hand_pose)
            if verdict.satisfied:
                continue
            self._verifier, self.program = verifier, str(program)
            self._episode += 1
            self._program_id = f"{self.about.arena_id}/{self._episode}"
            first = replace(seen, episode=self._episode, step=0, stamp_ns=stamp_ns)
            self.seen = replace(first, program_id=self._program_id)
            return Step(self.seen, verdict, self.program, arena_id=self.about.arena_id)
        raise ArenaError(
            "learning: expected a training program that does not hold yet, names an object on the "
            "table, and can be reached within the box; got none: scatter the blocks",
            code="robot.programs",
        )

    # Observations

    def observe(self, now_s: float, stamp_ns: int) -> Step:
        """The present step, stamped `stamp_ns`. Raises ArenaError if anything is not measured:
        `robot.joints`, `robot.poses`, `robot.gripper`, or `robot.model` if the hand is elsewhere
        than the model says."""
        at_hand = self._measure(now_s)
        hand, *_ = poses = [*self.measured.values()]
        joints = self.joints.at(at_hand.stamp_ns)
        if now_s - joints.arrived_s > ARM_TIMEOUT_S:
            raise ArenaError(_late("joint_states", now_s - joints.arrived_s), "robot.joints")
        position = self._as_learned(joints.position)
        self._apart = self._check_model(position, hand)
        self._note_move(joints.position)
        late_s = now_s - at_hand.arrived_s + self.settings.arm_delay_s
        self.believed.measured(joints.position, late_s, now_s)
        velocity = joints.velocity
        if self.settings.arm_delay_s:
            position, velocity = self._as_learned(self.believed.position), self.believed.velocity
            hand = self._hand_at(position)
            if self.holds:  # what is nearest to the grip goes with the hand
                held = 1 + int(RELATIONS[HOLD].measure(poses[0], np.array(poses[1:])).argmin())
                poses[held] = in_base(hand, in_hand(poses[0], poses[held]))
            poses[0] = hand
        kinds = [self._kinds[name] for name in self._present]
        objects = objects_from_poses(self._design.schema, kinds, np.array(poses))
        step = 0 if self.seen is None else self.seen.step + 1
        hand = self._with_grip(hand)
        measured = objects, position, velocity, 0, self._program_id, hand
        self.seen = Observation(self._episode, step, stamp_ns, *measured)
        over = self.lessons is not None and step >= self.lessons.episode_steps
        verdict = self._verifier.verdict(objects, hand, over) if self._verifier else None
        return Step(self.seen, verdict, self.program, arena_id=self.about.arena_id)

    def _note_move(self, position: Float64) -> None:
        before = position if self._joints_before is None else self._joints_before
        sent = float(np.abs(self.believed.velocity).max()) * self.about.control_period
        self._moves.append((float(np.abs(position - before).max()), sent))
        self._joints_before = position

    @property
    def follows(self) -> bool:
        """Whether the arm moves when it is told to. From one that does not, nothing is learned."""
        moved, sent = np.sum(self._moves, axis=0) if self._moves else (0.0, 0.0)
        return bool(sent < FOLLOW_RAD or moved >= FOLLOWS * sent)

    def _hand_at(self, position: Float64) -> Float64:
        """The hand's pose [7] when the joints will be there, as far off the model's as measured."""
        model, quaternion = self.model.hand(position), np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, (self._turned @ model.turn).ravel())
        quaternion = np.roll(quaternion, -1) * np.copysign(1.0, quaternion[0])
        return np.concatenate([model.place + self._apart, quaternion])

    def _with_grip(self, hand: Float64) -> Float64:
        """The hand's pose, and of a gripper whether it holds something. Raises ArenaError."""
        if self.settings.gripper is None:
            return hand
        if self.holds is None:
            where = self.settings.gripper.holds or f"joint {self.settings.gripper.joint}"
            raise ArenaError(f"gripper: nothing heard yet of {where}", code="robot.gripper")
        return np.append(hand, float(self.holds))

    def _as_learned(self, position: Float64) -> Float64:
        """Joint positions [J] in the model's ranges: a driver's -90 degrees may be its 270."""
        turns = np.round((position - self._middle) / (2 * np.pi))
        return np.asarray(position - 2 * np.pi * turns)

    def _measure(self, now_s: float) -> Placed:
        """Find the hand and the objects in the base's frame; how the hand was placed.

        Raises one ArenaError for all that is missing.
        """
        self.measured, missing, hand, ages = {}, [], Placed(IDENTITY), [0.0]
        for name in (HAND, *self._present):
            frame, offset = self._sources[name]
            oldest = ARM_TIMEOUT_S if name == HAND else self.settings.objects_timeout_s
            try:
                placed = self.frames.pose(self.settings.base_frame, frame)
            except ArenaError as error:
                missing.append(f"{name}: {error}")
                continue
            if now_s - placed.arrived_s > oldest:
                missing.append(_late(name, now_s - placed.arrived_s))
                continue
            hand = placed if name == HAND else hand
            ages.append(now_s - placed.arrived_s)
            pose = self.measured[name] = in_base(placed.pose, offset)
            pose[3:] *= np.copysign(1.0, pose[6])
        if missing:
            raise ArenaError("; ".join(missing), code="robot.poses")
        self.oldest_s = max(ages)
        return hand

    def _check_model(self, position: Float64, hand: Float64) -> Float64:
        """How far [3] (m) the hand is from the model's. Raises ArenaError (`robot.model`)."""
        model = self.model.hand(position)
        apart = float(np.linalg.norm(hand[:3] - model.place))
        turn = in_base(hand, AXES)[:, :3] - hand[:3]  # the measured axes as rows
        angle = float(np.arccos(np.clip((np.sum(turn * model.turn.T) - 1) / 2, -1.0, 1.0)))
        if apart > HAND_M or angle > HAND_RAD:
            raise ArenaError(
                f"the hand is {apart:.2f} m and {angle:.1f} rad from where the model of "
                f"{self.about.arm} puts it: check the joints' order, signs and offsets, and "
                "base_frame, hand_frame and hand_offset",
                code="robot.model",
            )
        self._turned = turn.T @ model.turn.T
        return hand[:3] - model.place

    # Commands

    def twist(self, linear: Float64, angular: Float64, in_hand: bool) -> Float64:
        """The joint velocities [J] (rad/s) by which the hand moves so: m/s and rad/s [3] each, in
        the base's frame or the hand's."""
        assert self.seen is not None
        hand = self.model.hand(self.seen.joint_position)
        turn = hand.turn if in_hand else np.eye(3)
        wanted = np.concatenate([turn @ linear, TURN_M * (turn @ angular)])
        rows = np.concatenate([hand.jacobian[:3], TURN_M * hand.jacobian[3:]])
        square = rows @ rows.T + DAMPING * np.eye(len(rows))
        return self._slowed(rows.T @ np.linalg.solve(square, wanted))

    def jog(self, velocity: Float64) -> Float64:
        """The joint velocities [J] (rad/s) for those of the driver's joints that a person wants."""
        return self._slowed(self.joints.to_driver(velocity, velocity)[1])  # a sign is its inverse

    def _slowed(self, velocity: Float64) -> Float64:
        """Joint velocities [J] with no joint above its speed limit: all slow down together."""
        return np.asarray(velocity / max(1.0, np.abs(velocity / self.about.speed_limits).max()))

    def velocity(self, command: Command) -> Float64:
        """The joint velocities [J] (rad/s) that a command wants. Raises ArenaError
        (`command.stale`) for one that answers none of the last observations."""
        newest_ns = self.seen.stamp_ns if self.seen else 0
        behind_s = (newest_ns - command.stamp_ns) / 1e9
        if not self.program or not 0 <= behind_s <= COMMAND_TIMEOUT_S:
            raise ArenaError(
                f"joint_commands: expected a command for an observation of the last "
                f"{COMMAND_TIMEOUT_S} s, under a program; got one for an observation "
                f"{behind_s:.1f} s old, under {self.program or 'none'}",
                code="command.stale",
            )
        action = command.action[: len(self.joints.names)]
        return np.asarray(np.clip(action, -1.0, 1.0) * self.about.speed_limits)

    def allowed(self, velocity: Float64) -> Float64:
        """The joint velocities [J] that the box allows where the arm is believed to be; rad/s."""
        position = self._as_learned(self.believed.position)
        hand = self.model.hand(position)
        place = hand.place + self._apart
        kept = self._guard.allowed(velocity, position, place, hand.jacobian[:3])
        there = lambda joints: self.model.hand(joints).place + self._apart  # noqa: E731
        return self._guard.stopping(kept, position, there)

    def hand_velocity(self, velocity: Float64) -> Float64:
        """The hand's velocity [3] (m/s, base's frame) at the newest observation."""
        if self.seen is None:
            return np.zeros(3)
        return np.asarray(self.model.hand(self.seen.joint_position).jacobian[:3] @ velocity)


def _late(what: str, age_s: float) -> str:
    return f"{what}: the newest one is {age_s:.1f} s old"
