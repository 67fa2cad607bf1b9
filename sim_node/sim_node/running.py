"""An arena as a node: it advances by control periods, and publishes the step that each led to.

`SimNode` adds what the arena receives: commands, programs and requests.
"""

from __future__ import annotations

import math
import time
import uuid
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from pa_ros.arena import PhysicsError
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Step
from pa_ros.core.extensions import ExtensionError
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.program import ProgramStatus, encode_program_status
from pa_ros.wire.services import ResetRequest
from pa_ros.wire.step import encode_step
from sim_node.commands import Watchdog
from sim_node.config import SimConfig
from sim_node.session import ActiveProgram, Session, SimError
from sim_node.viewers import Samples, StepViews


class ArenaNode(ManagedNode):
    """An arena that is paused, runs in lockstep, or runs in real time."""

    config: SimConfig

    def __init__(self) -> None:
        super().__init__("sim_node", SimConfig)

    def configure(self) -> None:
        self.session = Session(self.config, arena_id=uuid.uuid4().hex[:8])
        self.watchdog = Watchdog(self.session, self.config.command_timeout_s)
        self.paused = self.config.paused
        self._real_time = self.config.mode == "real_time"
        self._announced: ActiveProgram | None = None
        self._features_message = topics.OBJECT_FEATURES.type()  # filled again at each step
        self._published_at = -math.inf
        self._void: PaError | None = None  # why the last episode was void
        self._core_s = 0.0  # time spent in the arena itself
        self._create_publishers()
        self.session.begin()  # published once somebody subscribes
        if self._real_time:
            self._start_ticker(self.config.real_time_factor)

    def activate(self) -> None:
        """Resume where the arena stopped, without the command that moved the arm then."""
        self.watchdog.forget()
        self._publish_first_step()

    @property
    @abstractmethod
    def has_agent(self) -> bool:
        """Whether there is a program, and somebody who commands."""

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
        self._command_size = about.world.commands
        self._step_views = StepViews(self, about.joint_names)
        self._info.publish(encode_arena_info(about))
        self._provenance = topics.PROVENANCE.publisher(self)
        origin = self.session.origin(self.get_fully_qualified_name())
        self._provenance.publish(encode_provenance(origin))
        self.samples = Samples(self, self.session)

    # Steps

    def _start_ticker(self, factor: float) -> None:
        period_s = self.session.arena.control_period_s / factor
        self._ticker = steady_timer(self, period_s, self._tick)

    def _tick(self) -> None:
        if self.active and not self.paused:
            self._step(self.watchdog.tick)

    def _step(self, advance: Callable[..., Step], *given: Any) -> None:
        """Advance the arena by one control period and publish the step that it led to."""
        try:
            self._advance(advance, *given)
        except (PhysicsError, ExtensionError) as error:
            self.refusals.refuse("the episode is void", error)
            self._void = error
            with suppress(ExtensionError):  # a reset begins the next one then
                self._publish(self.session.begin())

    def _advance(self, advance: Callable[..., Step], *given: Any) -> None:
        started = time.perf_counter()
        step = advance(*given)
        advanced = time.perf_counter()
        self._publish(step)
        published = time.perf_counter()
        ended = self.session.finish_step()
        self._core_s += advanced - started + time.perf_counter() - published
        if ended:
            self._void = None
            self._publish(self.session.current)

    def _publish(self, step: Step) -> None:
        if self.session.program is not self._announced:
            self._announce()
        # The agent decides on this message, so the others come after it.
        self._features.publish(encode_step(step, self._features_message))
        self._step_views.publish(step)
        self._published_at = time.monotonic()

    def _publish_first_step(self) -> None:
        """In real time the first step is published whether or not somebody subscribes."""
        if self._real_time and not self.paused and self._published_at == -math.inf:
            self._publish(self.session.current)

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

    # Requests

    def begin(self, request: ResetRequest) -> None:
        """Begin an episode; raises what `Session.begin` raises."""
        self._publish(self.session.begin(request))

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
        self._start_ticker(factor)

    @property
    def speed(self) -> float:
        """Simulation time per wall time; 0 in lockstep."""
        if not self._real_time:
            return 0.0
        return float(self.session.arena.control_period_ns / self._ticker.timer_period_ns)
