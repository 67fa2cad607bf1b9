"""A real arm as a ROS node in the arena's place (docs/robot.md)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from pa_ros.arena.errors import ArenaError
from pa_ros.core.clock import now_ns
from pa_ros.core.errors import PaError
from pa_ros.core.experience import PERSON, AgentKey, CommandKey, Executed, Float64, Step
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.peers import PeerMonitor, is_restarted_agent
from pa_ros.ros.refusals import RateLimiter, answer_program
from pa_ros.ros.settings import NodeSettings
from pa_ros.wire import Message, WireError
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.program import decode_program, encode_program_status
from pa_ros.wire.robot import (
    Measurement,
    decode_detections,
    decode_driver_joints,
    decode_jog,
    decode_takeover,
    decode_tracked,
    decode_transforms,
    encode_table,
)
from pa_ros.wire.services import encode_triggered
from pa_ros.wire.step import Command, decode_command, encode_step
from sim_node.robot.arm import COMMAND_TIMEOUT_S, RealArm
from sim_node.robot.frames import Placed
from sim_node.robot.gripper import RobotGripper
from sim_node.robot.output import RobotOutput
from sim_node.robot.relay import Relay
from sim_node.robot.settings import load_robot, measured_frame

# Of a message: 600 transforms or 130 detections. A full queue of them takes less than a period.
LARGEST_BYTES = 64 * 1024
SHOW_S = 0.25  # wall time between two samples and sets of markers


class RobotConfig(NodeSettings):
    """Parameters of robot_node; the robot itself is in a file."""

    robot: str = Field("robot.yaml", description="file that describes the robot (docs/robot.md)")
    autostart: bool = Field(False, description="configure and activate at the start: may move!")


class RobotNode(ManagedNode):
    """Publishes what is measured as observations, and sends what agents command to the arm.

    It moves, and publishes observations, only while it is active.
    """

    config: RobotConfig

    def __init__(self) -> None:
        super().__init__("robot_node", RobotConfig)

    def configure(self) -> None:
        robot = load_robot(Path(self.config.robot))
        self.arm = RealArm(robot)
        self._loss: PaError | None = None  # why the arm holds
        self._step: Step | None = None
        self._stamp_ns, self._commanded_at = 0, -math.inf
        self._agents = PeerMonitor[AgentKey]("agent", is_restart=is_restarted_agent)
        self._program_rate = RateLimiter()

        self._features = self.advertise(topics.OBJECT_FEATURES)
        self._info = self.advertise(topics.ARENA_INFO)
        self._info.publish(encode_arena_info(self.arm.about))
        self._status = topics.PROGRAM_STATUS.publisher(self)
        self._samples = topics.SAMPLES.publisher(self)
        self._markers = topics.MARKERS.publisher(self)
        self.relay = self._start_relay()
        self.output = RobotOutput(self, self.arm, self.relay)
        settings = robot.settings
        self.gripper = None
        if settings.gripper is not None:
            told = partial(setattr, self.arm, "holds")
            given = settings.gripper, settings.dry_run, self._listen, told
            self.gripper = RobotGripper(self, *given)

        things = robot.objects.values()
        self._classes = {t.detection: measured_frame(t.detection) for t in things if t.detection}
        sources = [thing.source for thing in things]
        self.arm.frames.want([settings.hand_frame, *sources, settings.base_frame])
        self._listen(topics.JOINT_STATES, self._on_joints)
        self._listen(topics.TF, self._on_transforms)
        self._listen(topics.TF_STATIC, partial(self._on_transforms, static=True))
        if self._classes:
            self._listen(topics.DETECTIONS, self._on_detections)
        for topic in {thing.topic for thing in things if thing.topic}:
            self._listen(topics.tracked_pose(topic), partial(self._on_pose, topic))
        self._answered: Command | None = None  # an agent's, to the newest step
        self._taken_at = -math.inf  # when a person moved the arm last
        self._awaits_blocks, self._begins = self.arm.lessons is not None, False
        if self.arm.lessons is not None:
            self._serve(topics.SCATTER, self._ask_for_blocks)
            self._serve(topics.RESUME, self._resume)
        self._listen(topics.TAKEOVER, self._on_takeover)
        self._listen(topics.TAKEOVER_JOINTS, self._on_jog)
        self.subscribe(topics.PROGRAM, self._on_program)
        self.subscribe(topics.JOINT_COMMANDS, self._on_command)

        steady_timer(self, self.arm.about.control_period, self._step_once)
        steady_timer(self, SHOW_S, self._show)
        sends = "sends nothing (dry_run)" if robot.settings.dry_run else "moves the arm when active"
        self.get_logger().info(f"{self.config.robot}: {len(robot.objects)} objects; {sends}")
        if self.arm.lessons is not None:
            held_out = ", ".join(self.arm.lessons.held_out) or "none"
            self.get_logger().info(
                f"learns {len(self.arm.lessons.programs)} programs; held out: {held_out}"
            )

    def _start_relay(self) -> Relay | None:
        """The process that stops the arm if this one cannot; a trajectory ends by itself."""
        settings, about = self.arm.settings, self.arm.about
        if settings.dry_run or not settings.relay or settings.control == "joint_trajectory":
            return None
        return Relay(
            self.resolve_topic_name(topics.SETPOINTS[settings.control].name),
            settings.control,
            self.arm.joints.names,
            about.control_period,
            settings.max_acceleration,
            self.context.get_domain_id(),
        )

    def deactivate(self) -> None:
        self.output.rest()  # and `_step_once` continues

    def cleanup(self) -> None:
        self.output.stop()

    # Measurements

    def _listen(self, topic: topics.Topic, use: Callable[[bytes], None]) -> None:
        """Call back with the bytes of each message that is not too large to be read in time."""

        def receive(payload: Any) -> None:
            if len(payload) > LARGEST_BYTES:
                raise ArenaError(
                    f"expected at most {LARGEST_BYTES} bytes in a message, got {len(payload)}: "
                    "publish fewer entries in each",
                    "robot.size",
                )
            use(payload)

        self.subscribe(replace(topic, as_bytes=True), receive)

    def _on_joints(self, payload: bytes) -> None:
        names = self.arm.joints.names
        message = topics.JOINT_STATES.parse(payload, names)
        state = None if message is None else decode_driver_joints(message, names)
        if state is not None:
            self.arm.joints.add(*state, time.monotonic())

    def _on_transforms(self, payload: bytes, static: bool = False) -> None:
        # Static ones are sent once: any of them may be wanted later.
        topic = topics.TF_STATIC if static else topics.TF
        frames, refuse = self.arm.frames, partial(self.refusals.refuse, topic.name)
        measured, names = decode_transforms(payload, None if static else frames.wanted, refuse)
        frames.hear(names)
        for measurement in measured:
            self._place(topic.name, measurement, static)

    def _on_detections(self, payload: bytes) -> None:
        message = topics.DETECTIONS.parse(payload, self._classes)
        if message is not None:
            refuse = partial(self.refusals.refuse, topics.DETECTIONS.name)
            for measurement in decode_detections(message, self._classes, refuse):
                self._place(topics.DETECTIONS.name, measurement)

    def _on_pose(self, topic: str, payload: bytes) -> None:
        message = topics.tracked_pose(topic).parse(payload)
        if message is not None:
            self._place(topic, decode_tracked(message, measured_frame(topic)))

    def _place(self, topic: str, measurement: Measurement, static: bool = False) -> None:
        parent, child, pose, stamp_ns = measurement
        placed = Placed(pose) if static else Placed(pose, stamp_ns, time.monotonic())
        try:
            self.arm.frames.add(parent, child, placed)
        except ArenaError as error:  # the other measurements of a message count
            self.refusals.refuse(topic, error)

    # Learning without resets

    def _serve(self, service: tuple[str, Any], act: Callable[[], str]) -> None:
        """Answer a service of std_srvs/Trigger; a PaError is its answer, too."""

        def answer(_request: Message, response: Any) -> Any:
            try:
                return encode_triggered(response, True, act())
            except PaError as error:
                self.refusals.refuse(service[0], error)
                return encode_triggered(response, False, str(error))

        self.create_service(service[1], service[0], answer)

    def _ask_for_blocks(self) -> str:
        """Stop, and wait until a person has scattered the blocks."""
        self._awaits_blocks = True
        self.arm.leave_blocks()
        return "the arm holds: scatter the blocks, then resume"

    def _resume(self) -> str:
        """Continue with the blocks as they are now."""
        there = self.arm.take_blocks(time.monotonic())
        self._awaits_blocks, self._begins = False, True
        return f"continues with {', '.join(there)}"

    def _begin_episode(self) -> None:
        try:
            # Later than the step that ended the last episode: each step has a stamp of its own.
            self._step = self.arm.begin_episode(self._stamp_ns + 1)
        except PaError as error:
            self.refusals.refuse("learning", error)
            self._ask_for_blocks()
        else:
            self._features.publish(encode_step(self._step))

    def _publish(self, step: Step) -> None:
        """Publish a step and, where it ends an episode, the first step of the next one."""
        lessons, self._begins, begins = self.arm.lessons, False, self._begins
        if not begins:
            self._features.publish(encode_step(step))
            if lessons is not None and step.verdict is not None:
                lessons.count(step.verdict, step.executed is None)
            if step.verdict is None or not step.verdict.truncated or lessons is None:
                return
            if lessons.scatter_is_due:
                self._ask_for_blocks()
                return
        self._begin_episode()

    def _on_takeover(self, payload: bytes) -> None:
        message = topics.TAKEOVER.parse(payload)
        if message is None:
            return
        frame, linear, angular = decode_takeover(message)
        settings = self.arm.settings
        if frame not in ("", settings.base_frame, settings.hand_frame):
            expected = f"{settings.base_frame!r} or {settings.hand_frame!r}"
            raise WireError("takeover.header.frame_id", expected, repr(frame), "wire.frame")
        self._take_over(self.arm.twist(linear, angular, frame == settings.hand_frame))

    def _on_jog(self, payload: bytes) -> None:
        message = topics.TAKEOVER_JOINTS.parse(payload)
        if message is not None:
            self._take_over(self.arm.jog(decode_jog(message, self.arm.joints.names)))

    def _take_over(self, velocity: Float64) -> None:
        """Move the joints as a person wants, [J] rad/s."""
        self._check_obeys()
        self.output.send(velocity)
        self._taken_at = self._commanded_at = time.monotonic()

    @property
    def _is_taken(self) -> bool:
        return time.monotonic() - self._taken_at <= COMMAND_TIMEOUT_S

    def _executed(self) -> Executed | None:
        """What the arm did since the last step, if one command led to it; call once per step."""
        applied, answered = self.output.applied(), self._answered
        self._answered = None
        if answered is None or self.arm.settings.dry_run or not self.arm.follows:
            return None
        action = np.append(applied, answered.action[len(applied) :]).astype(np.float32)
        agent = PERSON if self._is_taken else answered.agent_id
        return Executed(CommandKey(agent, answered.incarnation, answered.number), action)

    # A control step: observation out, command in

    def _step_once(self) -> None:
        self._stamp_ns, executed = now_ns(), self._executed()
        was_lost = self._loss is not None
        try:
            self.output.check()
            if self.gripper is not None:
                self.gripper.check()
            seen = self.arm.observe(time.monotonic(), self._stamp_ns)
            self._step, self._loss = replace(seen, executed=executed), None
        except PaError as error:
            self._loss = error
            if self.active and not was_lost:
                self.refusals.refuse("the arm holds", error)
            if self.active and self.gripper is not None:
                self.gripper.lost()
        else:
            if self.active and not self._awaits_blocks:
                self._publish(self._step)
        halted = self._loss is not None or not self.active or self._awaits_blocks
        if halted or self._commands_are_late():
            self.output.rest()
        else:
            self.output.keep()

    def _on_command(self, message: Message) -> None:
        command = decode_command(message, self.arm.about.world.commands)
        agent = AgentKey(command.agent_id, command.incarnation)
        if not self._agents.received(agent, agent):
            return  # the diagnostics name this second agent
        self._check_obeys()
        velocity = self.arm.velocity(command)
        if self.arm.seen is not None and command.stamp_ns == self.arm.seen.stamp_ns:
            self._answered = command
        if self._is_taken:
            return  # a person moves the arm
        self.output.send(velocity)
        if self.gripper is not None:
            self.gripper.switch(on=bool(command.action[-1] > 0))
        self._commanded_at = time.monotonic()

    def _check_obeys(self) -> None:
        """Raise PaError unless the arm may move now."""
        if not self.active:
            raise ArenaError(f"expected an active robot_node, got {self.state}", "robot.inactive")
        if self._loss is not None:
            raise self._loss
        if self.arm.seen is None:
            raise ArenaError("expected an arm that is measured", code="robot.poses")
        if self._awaits_blocks:
            raise ArenaError(f"expected {topics.RESUME[0]} before the arm moves", "robot.scatter")

    def _commands_are_late(self) -> bool:
        return time.monotonic() - self._commanded_at > COMMAND_TIMEOUT_S

    def _on_program(self, message: Message) -> None:
        request = decode_program(message)
        self._program_rate.check()
        name = self.get_fully_qualified_name()
        status = answer_program(request, name, self._stamp_ns, self.arm.submit, self.refusals)
        self._status.publish(encode_program_status(status))

    # Displays

    def _show(self) -> None:
        if self._step is not None and self._samples.get_subscription_count():
            self._samples.publish(encode_step(self._step))
        if self._markers.get_subscription_count():
            settings, arm = self.arm.settings, self.arm
            box = settings.workspace.lower, settings.workspace.upper
            moving = arm.hand_velocity(self.output.velocity)
            shown = settings.base_frame, box, arm.measured, moving, self._stamp_ns
            self._markers.publish(encode_table(*shown))

    @property
    def trouble(self) -> str:
        return str(self._loss or "")

    def collect(self) -> tuple[int, str, dict[str, str]]:
        values = {
            "dry_run": str(self.arm.settings.dry_run).lower(),
            "step": str(self._step.observation.step if self._step else -1),
            "program": self.arm.program,
            "oldest_s": f"{self.arm.oldest_s:.2f}",
            "moved_by": PERSON if self._is_taken else "an agent",
        }
        if self.arm.lessons is not None:
            values |= self.arm.lessons.report()
        return *self._status_line(), values

    def _status_line(self) -> tuple[int, str]:
        if self._agents.fault:
            return ERROR, self._agents.fault
        if self._loss is not None:
            return ERROR, f"holds: {self._loss}"
        if self._awaits_blocks:
            return WARN, "holds: scatter the blocks, then press resume (pa_ros scatter)"
        if not self.arm.program:
            return OK, f"waits for a program ({topics.PROGRAM.name})"
        if self._commands_are_late():
            return WARN, f"holds: no agent's command ({topics.JOINT_COMMANDS.name})"
        if not self.arm.follows and not self.arm.settings.dry_run:
            return ERROR, "the arm does not follow what is sent: did its driver stop it?"
        return OK, "dry run: nothing is sent to the arm" if self.arm.settings.dry_run else "running"
