"""The arena as a ROS node.

In lockstep `_on_command` runs one control step: it decodes the command, checks that it answers the
current step, advances the arena and publishes the step it led to. In real time a timer does.
"""

from __future__ import annotations

import time

from pa_ros.core.experience import AgentKey
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.peers import PeerMonitor, is_restarted_agent
from pa_ros.ros.refusals import RateLimiter, answer_program
from pa_ros.wire import Message
from pa_ros.wire.program import decode_program, encode_program_status
from pa_ros.wire.step import Command, decode_command
from sim_node.commands import check_answer
from sim_node.entities import Entities
from sim_node.running import ArenaNode
from sim_node.services import Services
from sim_node.stepping import SteppingAction
from sim_node.viewers import CameraView, Tracks, Views


class SimNode(ArenaNode):
    """One arena. In lockstep each command advances it by one step; in real time a timer does."""

    def configure(self) -> None:
        super().configure()
        self._agents = PeerMonitor[AgentKey]("agent", is_restart=is_restarted_agent)
        self._program_rate = RateLimiter()
        self._had_subscribers = False
        self._reported = (time.monotonic(), 0, 0.0)  # time, steps, core_s at the last report
        self._commands = self.subscribe(topics.JOINT_COMMANDS, self._on_command)
        self.subscribe(topics.PROGRAM, self._on_program)
        self._create_services()
        self.get_logger().info(
            f"arena {self.session.arena_id}: design {self.config.design}, arm "
            f"{self.config.arm}, {self.session.arena.preset}, {self.config.mode}, programs "
            f"from {self.config.program_source}"
        )
        steady_timer(self, self.config.resend_period_s / 4, self._publish_again)

    def cleanup(self) -> None:
        if self._camera is not None:
            self._camera.close()
        self.session.task.close()

    def _create_services(self) -> None:
        """Services, and what people look at. Raises RenderError for a camera without OpenGL."""
        entities = Entities(self.session)
        Services(self, entities)
        self._stepping = SteppingAction(self)
        with_camera = self.config.camera.rate_hz > 0
        self._camera = CameraView(self, self.session) if with_camera else None
        Views(self, self.session, entities, self._camera)
        if self.session.perception:
            Tracks(self, self.session)

    # One control step

    def _on_command(self, message: Message) -> None:
        command = decode_command(message, self._command_size)
        agent = AgentKey(command.agent_id, command.incarnation)
        if not self._agents.received(agent, agent):
            return  # the diagnostics name this second agent
        self.check_active()
        if self.paused:
            # Agents answer whatever is published; nothing moves unless a step was requested.
            if self._stepping.awaits_command:
                self._answer(command)
                self._stepping.count()
        elif self._real_time:
            self.watchdog.offer(command)
        else:
            self._answer(command)

    def _answer(self, command: Command) -> None:
        check_answer(self.session, command)
        self._step(self.session.apply, command)

    def _publish_again(self) -> None:
        """Repeat a step that nobody answers: the agent may have started after it (lockstep).

        Waits one round after the first subscription, until the agent has all its subscriptions.
        """
        late = time.monotonic() - self._published_at > self.config.resend_period_s
        had_subscribers = self._had_subscribers
        self._had_subscribers = self._features.get_subscription_count() > 0
        waits = self._stepping.awaits_command if self.paused else not self._real_time
        if late and had_subscribers and self.active and waits:
            self.show()

    # Programs

    def _on_program(self, message: Message) -> None:
        request = decode_program(message)
        self.check_active()
        self._program_rate.check()
        if self.session.program is not self._announced:
            self._announce()  # the program of the current step, before it is replaced
        waiting = self.session.program is None
        stamp_ns = self.session.current.observation.stamp_ns
        name = self.get_fully_qualified_name()
        status = answer_program(request, name, stamp_ns, self.session.submit, self.refusals)
        self._status.publish(encode_program_status(status))
        if waiting and status.accepted:
            self._publish(self.session.current)

    @property
    def has_agent(self) -> bool:
        """Whether there is a program, and somebody who commands."""
        return self.session.program is not None and self._commands.get_publisher_count() > 0

    # Health

    def collect(self) -> tuple[int, str, dict[str, str]]:
        session, current = self.session, self.session.current
        now, steps = time.monotonic(), session.steps
        since, steps_then, core_then = self._reported
        self._reported = (now, steps, self._core_s)
        rate = (steps - steps_then) / max(now - since, 1e-9)
        values = {
            "mode": self.config.mode,
            "episode": str(current.observation.episode),
            "step": str(current.observation.step),
            "evaluation": str(current.evaluation).lower(),
            "steps": str(steps),
            "steps_per_s": f"{rate:.1f}",
            "core_us": f"{(self._core_s - core_then) * 1e6 / max(steps - steps_then, 1):.1f}",
            "real_time_factor": f"{rate * session.arena.control_period_s:.3f}",
            "clamped": str(session.clamped),
            "holds": str(self.watchdog.holds),
            "paused": str(self.paused).lower(),
        }
        if self._camera is not None:
            values["camera.pictures"] = str(self._camera.pictures)
        for evaluation, rewards in session.rewards.items():
            name = "eval" if evaluation else "train"
            if rewards:
                values[f"{name}.reward_per_step"] = f"{sum(rewards) / len(rewards):.4f}"
                values[f"{name}.episodes"] = str(len(rewards))
        return *self._status_line(rate), values

    def _status_line(self, rate: float) -> tuple[int, str]:
        """Level and message for /diagnostics; `rate` is in steps per second."""
        clock = self.resolve_topic_name(topics.CLOCK.name)  # after remapping
        if self.count_publishers(clock) > 1:
            return WARN, f"another node publishes {clock}, too: its readers see time jump"
        if self.paused:
            waits = f"waits for the service {topics.SET_SIMULATION_STATE[0]}"
            return OK, f"paused: {f'makes the requested steps, {rate:.0f}/s' if rate else waits}"
        if self.session.program is None:
            return OK, f"waits for a program ({topics.PROGRAM.name})"
        if self._agents.fault:
            return ERROR, self._agents.fault
        if self._void:
            return ERROR, f"the last episode was void: {self._void}"
        if not self._real_time and rate == 0.0:
            name = topics.JOINT_COMMANDS.name
            return WARN, f"waits for an agent's command ({name}): does agent_node run, and act?"
        return OK, "running"
