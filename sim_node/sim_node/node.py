"""The arena as a ROS node: each callback decodes, makes one core call, encodes, publishes."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Iterable

from pa_ros.arena import DivergedError
from pa_ros.core.experience import AgentKey
from pa_ros.ros import topics
from pa_ros.ros.authority import Authority
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import OK, WARN
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.programs import Pace, judge
from pa_ros.ros.rivals import Commanders
from pa_ros.wire import Message
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.program import (
    ProgramRequest,
    ProgramStatus,
    decode_program,
    encode_program,
    encode_program_status,
)
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import (
    StepContext,
    StepMessages,
    decode_command,
    encode_clock,
    encode_observation,
    encode_verdict,
)
from sim_node.components import Components
from sim_node.config import SimConfig
from sim_node.description import describe, origin
from sim_node.errors import InactiveError, LockstepError, NotPausedError, PausedError
from sim_node.session import Frame, Ordered, Session
from sim_node.watchdog import Watchdog


class SimNode(ManagedNode):
    """One arena. In lockstep a command moves it on; in real time a timer does."""

    config: SimConfig

    def __init__(self) -> None:
        super().__init__("sim_node", SimConfig)

    def configure(self) -> None:
        self.session = Session(self.config, arena_id=uuid.uuid4().hex[:8])
        self.watchdog = Watchdog(self.session, self.config.command_timeout_s)
        self._authority = Authority(self, self.config)
        self._commanders = Commanders()
        self._pace = Pace()
        self.paused = self.config.paused
        self._real_time = self.config.mode == "real_time"
        self._announced: Ordered | None = None
        self._sent = StepMessages()
        self._sent_at = -math.inf
        self._listened = False
        self._rate = (time.monotonic(), 0, 0.0)  # time, steps, core_s at the last report
        self._core_s = 0.0  # spent in the arena itself
        self._make_publishers()
        self._make_subscriptions()
        self.session.begin()  # sent as soon as someone listens
        self._components = Components(self, self, self.refusals)
        self.get_logger().info(
            f"arena {self.session.arena_id}: design {self.config.design}, arm "
            f"{self.config.arm}, {self.config.preset}, {self.config.mode}, programs "
            f"from {self.config.program_source}"
        )
        period = self.session.arena.control_period_s / self.config.real_time_factor
        if self._real_time:
            self._ticker = steady_timer(self, period, self._tick)
        else:
            steady_timer(self, self.config.resend_period_s / 4, self._send_again)

    def activate(self) -> None:
        """Time goes on where it stood, without the command that was obeyed then."""
        self.watchdog.forget()
        self._begin_sending()

    def cleanup(self) -> None:
        self._components.close()

    def alone(self) -> tuple[topics.Topic, str]:
        return topics.ARENA_INFO, self.session.arena_id

    def check_active(self) -> None:
        """Raise InactiveError unless the arena is active."""
        if not self.active:
            raise InactiveError(f"expected an active arena, got one that is {self.state}")

    def _make_publishers(self) -> None:
        self._features = topics.OBJECT_FEATURES.publisher(self)
        self._joints = topics.JOINT_STATES.publisher(self)
        self._verdict = topics.VERDICT.publisher(self)
        self._clock_topic = topics.CLOCK.publisher(self)
        self._program = topics.PROGRAM.publisher(self)
        self._status = topics.PROGRAM_STATUS.publisher(self)
        self._info = self._authority.publisher(topics.ARENA_INFO)
        about = describe(self.session)
        self._joint_names = about.joint_names
        self._info.publish(encode_arena_info(about))
        self._provenance = topics.PROVENANCE.publisher(self)
        account = origin(self.session, self.get_fully_qualified_name())
        self._provenance.publish(encode_provenance(account))

    def _make_subscriptions(self) -> None:
        command = topics.JOINT_COMMANDS
        on_command = self._authority.checked(command, self._on_command)
        command.subscribe(self, self.refusals.guard(command.name, on_command))
        program = topics.PROGRAM
        program.subscribe(self, self.refusals.guard(program.name, self._on_program))

    # One control step

    def _on_command(self, message: Message) -> None:
        command = decode_command(message, self.session.arena.joints)
        self._commanders.note(AgentKey(command.agent_id, command.incarnation))
        if self.paused or not self.active:
            self.check_active()
            raise PausedError("joint_commands: expected none while the arena is paused")
        if self._real_time:
            self.watchdog.offer(command)
            return
        self.session.check(command)
        self._run(self.session.apply(command))

    def _tick(self) -> None:
        if self.active and not self.paused:
            self._run(self.watchdog.tick())

    def _run(self, frames: Iterable[Frame]) -> None:
        started = time.perf_counter()
        try:
            for frame in frames:
                self._core_s += time.perf_counter() - started
                self._send(frame)
                started = time.perf_counter()
        except DivergedError as error:
            self.refusals.refuse("physics", error)
            self._send(self.session.begin())

    def _send(self, frame: Frame) -> None:
        """The observation first: a greedy agent decides while the rest is still being sent."""
        self._announce()
        observation = frame.observation
        arena_id, evaluation = self.session.arena_id, frame.evaluation
        context = StepContext(arena_id, evaluation, frame.executed, frame.program)
        sent = self._sent
        features, joints = encode_observation(observation, self._joint_names, context, sent)
        self._joints.publish(joints)
        self._features.publish(features)
        if self._verdict.get_subscription_count():  # greedy agents need none
            self._verdict.publish(encode_verdict(frame.verdict, evaluation, arena_id, sent.verdict))
        if self._clock_topic.get_subscription_count():
            self._clock_topic.publish(encode_clock(observation.stamp_ns, sent.clock))
        self._sent_at = time.monotonic()

    def _send_again(self) -> None:
        """Nobody answered: perhaps nobody was there yet."""
        late = time.monotonic() - self._sent_at > self.config.resend_period_s
        listened, self._listened = self._listened, self._features.get_subscription_count() > 0
        stands = self.paused or not self.active
        if late and listened and not stands:  # a turn later, when all topics are connected
            self._send(self.session.frame)

    # Programs

    def _announce(self) -> None:
        program = self.session.program
        if program is not self._announced and program is not None:
            if self.session.program_ids.is_own(program.program_id):
                request = ProgramRequest(program.program_id, program.text)
                self._program.publish(encode_program(request))
                ours = ProgramStatus(
                    request.program_id,
                    self.get_fully_qualified_name(),
                    True,
                    canonical=request.text,
                    stamp_ns=self.session.frame.observation.stamp_ns,
                )
                self._status.publish(encode_program_status(ours))  # latched, for who is late
        self._announced = program

    def _on_program(self, message: Message) -> None:
        request = decode_program(message)
        if self.session.program_ids.is_echo(request.program_id, request.text):
            return
        self.check_active()
        self._pace.check()
        self._announce()  # what the standing frame is under, before it is replaced
        idle = self.session.program is None
        stamp_ns = self.session.frame.observation.stamp_ns
        judgement = judge(
            request, self.get_fully_qualified_name(), stamp_ns, self.session.submit, self.refusals
        )
        self._status.publish(encode_program_status(judgement))
        if idle and judgement.accepted:
            self._send(self.session.frame)

    # Services

    def begin(self, request: ResetRequest) -> None:
        """As `Session.begin`."""
        self._send(self.session.begin(request))

    def hold(self, steps: int) -> None:
        """Let control periods pass while the arm holds still. NotPausedError."""
        if not self.paused:
            raise NotPausedError("step: expected a paused arena, got a running one")
        for _ in range(steps):
            self._run(self.session.advance(self.session.hold))

    def pause(self, paused: bool) -> None:
        """Stop time, or let it go on."""
        self.paused = paused
        self._begin_sending()

    def _begin_sending(self) -> None:
        """In real time the first step is sent whoever listens."""
        if self._real_time and not self.paused and self._sent_at == -math.inf:
            self._send(self.session.frame)

    def set_speed(self, factor: float) -> None:
        """Simulation time per wall time from now on. LockstepError."""
        if not self._real_time:
            raise LockstepError("speed: expected mode real_time, got lockstep")
        self.destroy_timer(self._ticker)  # one that is under way would end its old period first
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
        now, steps = time.monotonic(), self.session.steps
        since, steps_then, core_then = self._rate
        self._rate = (now, steps, self._core_s)
        rate = (steps - steps_then) / max(now - since, 1e-9)
        stands = self.session.frame
        values = {
            "mode": self.config.mode,
            "episode": str(stands.observation.episode),
            "step": str(stands.observation.step),
            "evaluation": str(stands.evaluation).lower(),
            "steps": str(steps),
            "steps_per_s": f"{rate:.1f}",
            "core_us": f"{(self._core_s - core_then) * 1e6 / max(steps - steps_then, 1):.1f}",
            "real_time_factor": f"{rate * self.session.arena.control_period_s:.3f}",
            "clamped": str(self.session.clamped),
            "holds": str(self.watchdog.holds),
            "paused": str(self.paused).lower(),
        }
        if self._components.camera is not None:
            values["camera.pictures"] = str(self._components.camera.pictures)
        for evaluation, rewards in self.session.rewards.items():
            name = "eval" if evaluation else "train"
            if rewards:
                values[f"{name}.reward_per_step"] = f"{sum(rewards) / len(rewards):.4f}"
                values[f"{name}.episodes"] = str(len(rewards))
        return *self._state(rate), values

    def _state(self, rate: float) -> tuple[int, str]:
        """Level and message: what the arena is doing, or waits for, at so many steps a second."""
        clock = self.resolve_topic_name(topics.CLOCK.name)  # as it is remapped
        if self.count_publishers(clock) > 1:
            return WARN, f"another publishes {clock}, too: time jumps for who reads it"
        if self.paused:
            return OK, f"paused: waits for the service {topics.PAUSE[0]}"
        if self.session.program is None:
            return OK, f"waits for a program ({topics.PROGRAM.name})"
        if self._commanders.alarm:
            return WARN, self._commanders.alarm
        if not self._real_time and rate == 0.0:
            name = topics.JOINT_COMMANDS.name
            return WARN, f"waits for an agent's command ({name}): does agent_node run, and act?"
        return OK, "running"
