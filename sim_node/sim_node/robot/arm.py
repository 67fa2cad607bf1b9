"""A real arm as agents see an arena: observations, verdicts, and the velocities that it may have.

Without ROS. The caller gives the time of its monotonic clock.
"""

from __future__ import annotations

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.controllers import hand_controller
from pa_ros.arena.task import GoalVerifier, scoring_of, world_of
from pa_ros.core.experience import Float64, Observation, Step
from pa_ros.language import parse_goal
from pa_ros.wire.arena import describe_robot
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.step import Command
from pa_ros.world import reward_from
from pa_ros.world.poses import IDENTITY, in_base, objects_from_poses
from sim_node.robot.frames import FrameTree, Placed, RobotError
from sim_node.robot.guard import Guard
from sim_node.robot.joints import JointHistory
from sim_node.robot.settings import Robot, pose_of

SLOW = 2.0  # command timeouts: one without commands takes the hand half of the way to the box
AXES = np.hstack([np.eye(3), np.tile(IDENTITY[3:], (3, 1))])  # poses, [3, 7]
HAND_M, HAND_RAD = 0.05, 0.2  # greatest differences of the measured hand and the model's


class RealArm:
    """The arm and the objects that robot.yaml describes.

    `frames` and `joints` are what was measured; the caller adds to them.
    """

    def __init__(self, robot: Robot) -> None:
        settings = self.settings = robot.settings
        config, design = settings.arena_config(), settings.design_of()
        self.frames, self.joints = FrameTree(), JointHistory(robot.joints)
        self.seen: Observation | None = None  # the newest observation
        self.program: str = ""  # canonical text; empty: none yet
        self.measured: dict[str, Float64] = {}  # pose [7] in the base's frame, by object
        self.model = hand_controller(config)
        self._kinds, self._sources = robot.kinds, robot.sources
        self._hand_offset = pose_of(settings.hand_offset, "hand_offset")
        self._schema, self._vocabulary = design.schema, design.vocabulary
        self._bodiless = design.vocabulary.bodiless
        self._scoring = scoring_of(config, design, reward_from(settings.reward))
        self._verifier: GoalVerifier | None = None
        self._program_id = ""
        # The agent learned that joints stop here, where the real ones may turn on. Only a base may
        # turn without limits.
        limits = [(joint.lower, joint.upper) for joint in ARMS[config.arm].joints]
        if ARMS[config.arm].joints[0].limits is None:
            limits[0] = -np.inf, np.inf
        lower, upper = np.array(limits).T
        self._middle = np.array(
            [sum(ends) / 2 if np.isfinite(ends).all() else np.nan for ends in limits]
        )
        speeds = np.array(config.joint_speed_limits) * settings.speed_scale
        self._guard = Guard(
            settings.workspace, lower, upper, speeds, SLOW * settings.command_timeout_s
        )
        names = self.joints.names
        self.about = describe_robot(
            world_of(config, design),
            dict(zip(names, speeds.tolist(), strict=True)),
            settings.period_s,
            arm=settings.arm,
            limits=limits,
        )

    # Programs

    def submit(self, request: ProgramRequest) -> str:
        """Put a program in force; its canonical text. Raises ProgramError; nothing changes then."""
        program = parse_goal(request.text, self._vocabulary)
        self._verifier = GoalVerifier(program, self._kinds, self._scoring, self._bodiless)
        self._program_id, self.program = request.program_id, str(program)
        return self.program

    # Observations

    def observe(self, now_s: float, stamp_ns: int) -> Step:
        """The present step, stamped `stamp_ns`. Raises RobotError if anything is not measured:
        `robot.joints`, `robot.poses`, or `robot.model` if the hand is elsewhere than the model
        says."""
        hand, poses = self._measure(now_s)
        joints = self.joints.at(hand.stamp_ns)
        self._check_age(now_s, joints.arrived_s, self.settings.arm_timeout_s, "joint_states")
        position = self._unwound(joints.position)
        self._check_model(position, hand.pose)
        objects = objects_from_poses(self._schema, self._kinds, np.array([hand.pose, *poses]))
        step = 0 if self.seen is None else self.seen.step + 1
        measured = objects, position, joints.velocity, 0, self._program_id, hand.pose
        self.seen = Observation(0, step, stamp_ns, *measured)
        verdict = self._verifier.verdict(objects, hand.pose) if self._verifier else None
        return Step(self.seen, verdict, self.program, arena_id=self.about.arena_id)

    def check(self, now_s: float) -> None:
        """Raise RobotError as `observe` does, if joints or poses are lost."""
        hand, _ = self._measure(now_s)
        arrived_s = self.joints.at(hand.stamp_ns).arrived_s
        self._check_age(now_s, arrived_s, self.settings.arm_timeout_s, "joint_states")

    def _measure(self, now_s: float) -> tuple[Placed, list[Float64]]:
        """The hand, and the objects' poses in the base's frame; what is missing, in one error."""
        settings, base = self.settings, self.settings.base_frame
        wanted = {"hand": (settings.hand_frame, self._hand_offset), **self._sources}
        found: dict[str, Placed] = {}
        missing = []
        for name, (frame, offset) in wanted.items():
            oldest = settings.arm_timeout_s if name == "hand" else settings.objects_timeout_s
            try:
                placed = self.frames.pose(base, frame)
                self._check_age(now_s, placed.arrived_s, oldest, frame)
            except RobotError as error:
                missing.append(f"{name}: {error}")
                continue
            pose = in_base(placed.pose, offset)
            pose[3:] *= np.copysign(1.0, pose[6])
            found[name] = Placed(pose, placed.stamp_ns, placed.arrived_s)
        self.measured = {name: placed.pose for name, placed in found.items()}
        if missing:
            raise RobotError("; ".join(missing), code="robot.poses")
        hand, *objects = found.values()
        return hand, [placed.pose for placed in objects]

    def _unwound(self, position: Float64) -> Float64:
        """The angles [J] within half a turn of the middle of their range: a driver's -90 degrees
        may be the model's 270."""
        away = position - self._middle
        whole = np.round(np.nan_to_num(away) / (2 * np.pi))
        return np.asarray(position - 2 * np.pi * whole)

    def _check_age(self, now_s: float, arrived_s: float, oldest_s: float, what: str) -> None:
        age = now_s - arrived_s
        if age > oldest_s:
            code = "robot.joints" if what == "joint_states" else "robot.poses"
            raise RobotError(f"{what}: expected at most {oldest_s:g} s old, got {age:.1f} s", code)

    def _check_model(self, position: Float64, hand: Float64) -> None:
        model = self.model.hand(position)
        apart = float(np.linalg.norm(model.place - hand[:3]))
        turn = in_base(hand, AXES)[:, :3] - hand[:3]  # the measured axes as rows
        angle = float(np.arccos(np.clip((np.sum(turn * model.turn.T) - 1) / 2, -1.0, 1.0)))
        if apart > HAND_M or angle > HAND_RAD:
            raise RobotError(
                f"the hand is {apart:.2f} m and {angle:.1f} rad from where the model of "
                f"{self.settings.arm} puts it: check the joints' order, signs and offsets, and "
                "base_frame, hand_frame and hand_offset",
                code="robot.model",
            )

    # Commands

    def velocity(self, command: Command, stamp_ns: int) -> Float64:
        """The joint velocities [J] (rad/s) that a command wants, within the box.

        :param stamp_ns: now, as stamps of observations. Raises RobotError (`command.stale`) for a
            command that answers none of the last observations.
        """
        oldest_ns = stamp_ns - int(self.settings.command_timeout_s * 1e9)
        seen = self.seen
        if seen is None or not self.program or not oldest_ns <= command.stamp_ns <= seen.stamp_ns:
            raise RobotError(
                f"joint_commands: expected a stamp of the last {self.settings.command_timeout_s} s "
                f"and a program, got {command.stamp_ns} and {self.program or 'none'}",
                code="command.stale",
            )
        shares = np.clip(command.action.astype(np.float64), -1.0, 1.0)
        return np.asarray(shares * self.about.speed_limits)

    def allowed(self, velocity: Float64) -> Float64:
        """The joint velocities [J] that the box allows at the newest observation; rad/s."""
        seen = self.seen
        assert seen is not None  # there is no command without an observation
        jacobian = self.model.hand(seen.joint_position).jacobian
        return self._guard.allowed(velocity, seen.joint_position, seen.hand_pose[:3], jacobian[:3])

    def hand_velocity(self, velocity: Float64) -> Float64:
        """The hand's velocity [3] (m/s, base's frame) at the newest observation."""
        if self.seen is None:
            return np.zeros(3)
        return np.asarray(self.model.hand(self.seen.joint_position).jacobian[:3] @ velocity)
