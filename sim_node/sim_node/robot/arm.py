"""A real arm as agents see an arena: observations, verdicts, and the velocities that it may have.

Without ROS. The caller gives the time of its monotonic clock.
"""

from __future__ import annotations

import numpy as np

from pa_ros.arena.arms import ARMS
from pa_ros.arena.errors import ArenaError
from pa_ros.arena.kinematics import hand_controller
from pa_ros.arena.task import GoalVerifier, scoring_of, world_of
from pa_ros.core.experience import Float64, Observation, Step
from pa_ros.language import parse_goal
from pa_ros.wire.arena import describe_robot
from pa_ros.wire.program import ProgramRequest
from pa_ros.wire.step import Command
from pa_ros.world import reward_from
from pa_ros.world.poses import IDENTITY, in_base, objects_from_poses
from pa_ros.world.velocity import DeadReckoning
from sim_node.robot.frames import FrameTree, Placed
from sim_node.robot.guard import Guard
from sim_node.robot.joints import JointHistory
from sim_node.robot.relay import SILENCE_S
from sim_node.robot.settings import Robot, pose_of

COMMAND_TIMEOUT_S = 0.3  # without a command the arm holds: three control periods
ARM_TIMEOUT_S = 0.2  # greatest age of the joints and the hand
AXES = np.hstack([np.eye(3), np.tile(IDENTITY[3:], (3, 1))])  # poses, [3, 7]
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
        self.measured: dict[str, Float64] = {}  # pose [7] in the base's frame, by object
        self.model = hand_controller(config)
        self._kinds = robot.kinds
        hand = settings.hand_frame, pose_of(settings.hand_offset)
        things = {name: (t.source, pose_of(t.offset)) for name, t in robot.objects.items()}
        self._sources = {"hand": hand, **things}  # frame that measures it, and its pose there
        self._scoring = scoring_of(config, self._design, reward_from(settings.reward))
        self._verifier: GoalVerifier | None = None
        self._program_id = ""
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
        self._apart = np.zeros(3)  # m, from the model's hand to the measured one
        self.about = describe_robot(
            world_of(config, self._design),
            dict(zip(self.joints.names, speeds.tolist(), strict=True)),
            config.control_period_s,
            self._design.name,
            config.preset,
            settings.arm,
            limits=limits,
        )

    # Programs

    def submit(self, request: ProgramRequest) -> str:
        """Put a program in force; its canonical text. Raises ProgramError; nothing changes then."""
        program = parse_goal(request.text, self._design.vocabulary)
        schema = self._design.schema
        self._verifier = GoalVerifier(program, self._kinds, self._scoring, schema)
        self._program_id, self.program = request.program_id, str(program)
        return self.program

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
        self.believed.measured(joints.position, now_s - at_hand.arrived_s, now_s)
        objects = objects_from_poses(self._design.schema, self._kinds, np.array(poses))
        step = 0 if self.seen is None else self.seen.step + 1
        hand = self._with_grip(hand)
        measured = objects, position, joints.velocity, 0, self._program_id, hand
        self.seen = Observation(0, step, stamp_ns, *measured)
        verdict = self._verifier.verdict(objects, hand) if self._verifier else None
        return Step(self.seen, verdict, self.program, arena_id=self.about.arena_id)

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
        self.measured, missing, hand = {}, [], Placed(IDENTITY)
        for name, (frame, offset) in self._sources.items():
            oldest = ARM_TIMEOUT_S if name == "hand" else self.settings.objects_timeout_s
            try:
                placed = self.frames.pose(self.settings.base_frame, frame)
            except ArenaError as error:
                missing.append(f"{name}: {error}")
                continue
            if now_s - placed.arrived_s > oldest:
                missing.append(_late(name, now_s - placed.arrived_s))
                continue
            hand = placed if name == "hand" else hand
            pose = self.measured[name] = in_base(placed.pose, offset)
            pose[3:] *= np.copysign(1.0, pose[6])
        if missing:
            raise ArenaError("; ".join(missing), code="robot.poses")
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
                f"{self.settings.arm} puts it: check the joints' order, signs and offsets, and "
                "base_frame, hand_frame and hand_offset",
                code="robot.model",
            )
        return hand[:3] - model.place

    # Commands

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
