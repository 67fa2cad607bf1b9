"""The arena as a ROS node.

In lockstep `_on_command` runs one control step: it decodes the command, checks that it answers the
current step, advances the arena and publishes the step it led to. In real time a timer does.
"""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Callable
from typing import Any

from pa_ros.arena import PhysicsError
from pa_ros.core.experience import AgentKey, Step
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.peers import PeerMonitor, is_restarted_agent
from pa_ros.ros.refusals import RateLimiter, answer_program
from pa_ros.wire import Message
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.program import (
    ProgramStatus,
    decode_program,
    encode_program_status,
)
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import Command, decode_command, encode_step
from sim_node.commands import Watchdog, check_answer
from sim_node.config import SimConfig
from sim_node.entities import Entities
from sim_node.services import Services
from sim_node.session import ActiveProgram, Session, SimError
from sim_node.stepping import SteppingAction
from sim_node.viewers import CameraView, Samples, StepViews, Tracks, Views


class SimNode(ManagedNode):
    """One arena. In lockstep each command advances it by one step; in real time a timer does."""

    config: SimConfig

    def __init__(self) -> None:
        super().__init__("sim_node", SimConfig)

    def configure(self) -> None:
        self.session = Session(self.config, arena_id=uuid.uuid4().hex[:8])
        self.watchdog = Watchdog(self.session, self.config.command_timeout_s)
        self._agents = PeerMonitor[AgentKey]("agent", is_restart=is_restarted_agent)
        self._program_rate = RateLimiter()
        self.paused = self.config.paused
        self._real_time = self.config.mode == "real_time"
        self._announced: ActiveProgram | None = None
        self._features_message = topics.OBJECT_FEATURES.type()  # filled again at each step
        self._published_at = -math.inf
        self._had_subscribers = False
        self._reported = (time.monotonic(), 0, 0.0)  # time, steps, core_s at the last report
        self._core_s = 0.0  # time spent in the arena itself
        self._create_publishers()
        self._create_subscriptions()
        self.session.begin()  # published once somebody subscribes
        self._create_services()
        self.get_logger().info(
            f"arena {self.session.arena_id}: design {self.config.design}, arm "
            f"{self.config.arm}, {self.session.arena.preset}, {self.config.mode}, programs "
            f"from {self.config.program_source}"
        )
        period_s = self.session.arena.control_period_s / self.config.real_time_factor
        if self._real_time:
            self._ticker = steady_timer(self, period_s, self._tick)
        steady_timer(self, self.config.resend_period_s / 4, self._publish_again)

    def activate(self) -> None:
        """Resume where the arena stopped, without the command that moved the arm then."""
        self.watchdog.forget()
        self._publish_first_step()

    def cleanup(self) -> None:
        if self._camera is not None:
            self._camera.close()
        self.session.task.close()

    def check_active(self) -> None:
        """Raise SimError unless the arena is active."""
        if not self.active:
            text = f"expected an active arena, got one that is {self.state}"
            raise SimError(text, code="arena.inactive")

    def _create_publishers(self) -> None:
        self._features = self.advertise(topics.OBJECT_FEATURES)
        self._status = topics.PROGRAM_STATUS.publisher(self)
        self._info = self.advertise(topics.ARENA_INFO)
        about = self.session.describe()
        self._joints = len(about.joint_names)
        self._step_views = StepViews(self, about.joint_names)
        self._info.publish(encode_arena_info(about))
        self._provenance = topics.PROVENANCE.publisher(self)
        origin = self.session.origin(self.get_fully_qualified_name())
        self._provenance.publish(encode_provenance(origin))

    def _create_subscriptions(self) -> None:
        self._commands = self.subscribe(topics.JOINT_COMMANDS, self._on_command)
        self.subscribe(topics.PROGRAM, self._on_program)

    def _create_services(self) -> None:
        """Services, and what people look at. Raises RenderError for a camera without OpenGL."""
        entities = Entities(self.session)
        Services(self, entities)
        self._stepping = SteppingAction(self)
        with_camera = self.config.camera.rate_hz > 0
        self._camera = CameraView(self) if with_camera else None
        Views(self, entities, self._camera)
        self.samples = Samples(self)
        if self.session.perception:
            Tracks(self, self.session.task)

    # One control step

    def _on_command(self, message: Message) -> None:
        command = decode_command(message, self._joints)
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

    def _tick(self) -> None:
        if self.active and not self.paused:
            self._step(self.watchdog.tick)

    def _step(self, advance: Callable[..., Step], *given: Any) -> None:
        """Advance the arena by one control period and publish the step that it led to."""
        started = time.perf_counter()
        try:
            step = advance(*given)
        except PhysicsError as error:
            self.refusals.refuse("physics", error)
            self._publish(self.session.begin())
            return
        advanced = time.perf_counter()
        self._publish(step)
        published = time.perf_counter()
        ended = self.session.finish_step()
        self._core_s += advanced - started + time.perf_counter() - published
        if ended:
            self._publish(self.session.current)

    def _publish(self, step: Step) -> None:
        if self.session.program is not self._announced:
            self._announce()
        # The agent decides on this message, so the others come after it.
        self._features.publish(encode_step(step, self._features_message))
        self._step_views.publish(step)
        self._published_at = time.monotonic()

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

    def _publish_first_step(self) -> None:
        """In real time the first step is published whether or not somebody subscribes."""
        if self._real_time and not self.paused and self._published_at == -math.inf:
            self._publish(self.session.current)

    # Programs

    def _announce(self) -> None:
        """Publish the active program if the arena drew it."""
        program = self._announced = self.session.program
        if program is not None and self.session.book.is_own(program.program_id):
            name = self.get_fully_qualified_name()
            stamp_ns = self.session.current.observation.stamp_ns
            status = ProgramStatus(
                program.program_id, name, True, canonical=program.text, stamp_ns=stamp_ns
            )
            self._status.publish(encode_program_status(status))

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

    # Services

    def begin(self, request: ResetRequest) -> None:
        """Begin an episode; raises what `Session.begin` raises."""
        self._publish(self.session.begin(request))

    @property
    def has_agent(self) -> bool:
        """Whether there is a program, and somebody who commands."""
        return self.session.program is not None and self._commands.get_publisher_count() > 0

    def show(self) -> None:
        """Publish the current step again."""
        self._publish(self.session.current)

    def check_paused(self) -> None:
        """Raise SimError unless the arena is active and paused."""
        self.check_active()
        if not self.paused:
            text = "step: expected a paused arena, got a running one"
            raise SimError(text, code="arena.not_paused")

    def hold(self, steps: int) -> None:
        """Run control periods of a paused arena while the arm holds still. SimError if running."""
        self.check_paused()
        for _ in range(steps):
            self._step(self.session.advance, self.session.hold)

    def pause(self, paused: bool) -> None:
        """Stop or resume simulation time."""
        self.paused = paused
        self._publish_first_step()
        self.samples.show()

    def set_speed(self, factor: float) -> None:
        """Set simulation time per wall time. Raises SimError in lockstep."""
        if not self._real_time:
            text = "speed: expected mode real_time, got lockstep"
            raise SimError(text, code="arena.lockstep")
        # A timer whose period is changed would first complete the old period.
        self.destroy_timer(self._ticker)
        period_s = self.session.arena.control_period_s / factor
        self._ticker = steady_timer(self, period_s, self._tick)

    @property
    def speed(self) -> float:
        """Simulation time per wall time; 0 in lockstep."""
        if not self._real_time:
            return 0.0
        return float(self.session.arena.control_period_ns / self._ticker.timer_period_ns)

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
        if not self._real_time and rate == 0.0:
            name = topics.JOINT_COMMANDS.name
            return WARN, f"waits for an agent's command ({name}): does agent_node run, and act?"
        return OK, "running"
