"""Managed nodes: the standard's states, transitions and services (docs/ros.md)."""

from __future__ import annotations

import gc
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from pa_ros.core.errors import PaError
from pa_ros.core.settings import Settings
from pa_ros.ros.actions import servers_of
from pa_ros.ros.executor import is_of_spinning
from pa_ros.ros.health import ERROR, WARN, HealthReporter
from pa_ros.ros.parameters import declare_settings, loosen_settings, settings_from_parameters
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import ROS_CLOCK, Topic
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import Health
from pa_ros.wire.services import decode_transition
from pa_ros.wire.step import decode_clock

FREEZING = ("configure", "cleanup")  # what is there after these stays for long
LIFECYCLE = "lifecycle"  # key of /diagnostics: the state
HINTS = {
    "unconfigured": "waits to be configured (ros2 lifecycle set {} configure)",
    "inactive": "waits to be activated (ros2 lifecycle set {} activate)",
    "finalized": "was shut down: end the process, and start it anew",
}


class TransitionError(PaError):
    """A transition that there isn't from the state that the node is in."""

    code = "lifecycle.transition"


class ManagedNode(LifecycleNode, ABC):
    """A node that is configured and activated at its start, unless `autostart` is false.

    A node of ours says what happens in `configure`, `activate`, `deactivate`, `cleanup`. Whatever
    topics, services and timers it has made since `configure` are destroyed after `cleanup`;
    actions stay, and reject goals until `configure` makes them again. A PaError refuses a
    transition, with what `configure` had made destroyed again; it is logged and counted or, at the
    start, raised. Other errors are bugs, and end the process.
    """

    config: Any  # settings, fixed while configured
    active = False  # asked with every message
    ended_by: PaError | None = None  # set: the process ends, as where a parameter is refused

    def __init__(self, name: str, settings: type[Settings]) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.refusals = Refusals(self.get_logger().warning)
        self.exit_status = 0  # of the process, if all else goes well
        self._guard_clock()
        self._settings, self._configured = settings, False
        self._error: Exception | None = None  # of the newest transition
        declare_settings(self, settings)
        self._health = HealthReporter(
            self, self.refusals, self._report, self._progress, hear=self._hear
        )
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        self._own = {id(entity) for _, entity in self._entities()}
        if self.get_parameter("autostart").value is not False:
            for trigger in (self.trigger_configure, self.trigger_activate):
                trigger()
                self._raise()

    def _guard_clock(self) -> None:
        """Under `use_sim_time`: a time before zero is refused, which rclpy takes for a bug."""
        source, topic = self._time_source, ROS_CLOCK.name
        believed = source.clock_callback

        def hear(message: Message) -> None:
            decode_clock(message)
            believed(message)

        source.clock_callback = self.refusals.guard(topic, hear)
        for subscription in self.subscriptions:
            if subscription.callback == believed:
                subscription.callback = source.clock_callback

    # What a node of ours says

    def configure(self) -> None:
        """Build everything from `config`; speak to nobody who has not asked."""

    def activate(self) -> None:
        """Begin, or go on; `active` is already true."""

    def deactivate(self) -> None:
        """Come to rest; `active` is already false. What is heard from now on changes nothing."""

    def cleanup(self) -> None:
        """Save and close what `configure` opened; the node is not active."""

    def shutdown(self) -> None:
        """End, configured, in whatever state."""
        if self.active:
            self.active = False
            self.deactivate()
        self.cleanup()

    @abstractmethod
    def alone(self) -> tuple[Topic, str]:
        """A topic on which one active process alone should speak, and this one's name there."""

    @abstractmethod
    def collect(self) -> tuple[int, str, dict[str, str]]:
        """For /diagnostics, configured: level, message, figures."""

    @property
    def trouble(self) -> str:
        """What a person has to see to though the node is inactive; empty: nothing."""
        return ""

    def progress(self) -> str:
        """A line for the log every few seconds while active; empty: none."""
        return ""

    def hear(self, health: Health) -> None:
        """What any node says of itself, heard while configured."""

    # The state machine

    @property
    def state(self) -> str:
        """The standard's name of the state that the node is in."""
        return str(self._state_machine.current_state[1])

    def close(self) -> int:
        """End in whatever state; the process's exit status. The node is then to be destroyed."""
        if self.state != "finalized":
            self.trigger_shutdown()
            self._raise()
        return self.exit_status

    def destroy_node(self) -> None:
        for server in servers_of(self):  # which rclpy would leave there
            server.destroy()
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(lambda: self._end(self.cleanup))

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(lambda: self._end(self.shutdown))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After a bug: save what can be saved. The process ends, with the bug's own traceback."""
        try:
            self._end(self.shutdown)
        except Exception as error:
            self.get_logger().error(f"on the way out: {error!r}")
        return TransitionCallbackReturn.SUCCESS

    def _attempt(self, body: Callable[[], None]) -> TransitionCallbackReturn:
        self._error = None
        try:
            body()
        except PaError as error:
            self._error = error
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self._error = error
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _raise(self) -> None:
        """Why the newest transition came to nothing, if it did."""
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _configure(self) -> None:
        try:
            self.config = settings_from_parameters(self, self._settings)
            self.configure()
        except BaseException:
            self._forget()
            raise
        self._configured = True

    def _activate(self) -> None:
        self.active = True
        try:
            self.activate()
        except BaseException:
            self.active = False
            raise
        self._health.alone(*self.alone())

    def _deactivate(self) -> None:
        self.active = False
        self._health.not_alone()
        self.deactivate()

    def _end(self, how: Callable[[], None]) -> None:
        configured, self._configured = self._configured, False
        self._health.not_alone()
        try:
            if configured:
                how()
        finally:
            self.active = False
            self._forget()

    def _forget(self) -> None:
        """Destroy what was made since `configure`, actions put to rest; parameters may be set
        again."""
        for destroy, entity in [*self._entities()]:
            kept = id(entity) in self._own or self._hears_clock(entity)
            if not kept and not is_of_spinning(entity):
                destroy(entity)
        for server in servers_of(self):
            server.rest()
        loosen_settings(self, self._settings)

    def _hears_clock(self, entity: Any) -> bool:
        """Whether it is rclpy's subscription to /clock, made whenever `use_sim_time` is set."""
        callback = getattr(entity, "callback", None)
        return callback is not None and callback is self._time_source.clock_callback

    def _entities(self) -> Iterator[tuple[Callable[[Any], Any], Any]]:
        """What the node has, and what destroys it; events of topics go with those."""
        for destroy, kind in (
            (self.destroy_timer, self.timers),
            (self.destroy_service, self.services),
            (self.destroy_subscription, self.subscriptions),
            (self.destroy_publisher, self.publishers),
        ):
            yield from ((destroy, entity) for entity in kind)

    def _on_change_state(self, request: Message, response: Any) -> Any:
        """rclpy's, but for transitions that there aren't, which would end the node."""
        number, label = decode_transition(request)
        there = [(one[0], one[1]) for one in self._state_machine.available_transitions]
        wanted = [one for one in there if (one[1] == label if label else one[0] == number)]
        try:
            if not wanted:
                raise TransitionError(
                    f"transition: expected one of {sorted({name for _, name in there})} from the "
                    f"state {self.state}, got {label or number!r}"
                )
            response = self._change_state(request, response)
            self._raise()
            name = wanted[0][1]
            self.get_logger().info(f"{name}: now {self.state}")
            if name in FREEZING and gc.get_freeze_count():  # as at the process's start
                gc.unfreeze()
                gc.collect()
                gc.freeze()
        except PaError as error:
            self.refusals.refuse("change_state", error)
        finally:
            self._health.publish()
        return response

    # Health

    def _report(self) -> tuple[int, str, dict[str, str]]:
        state, name = self.state, self.get_fully_qualified_name()
        if self._configured:
            level, message, values = self.collect()
        else:
            level, message, values = WARN, "", {}
        if not self.active:
            level = ERROR if self._configured and self.trouble else WARN
            hint = HINTS.get(state, "changes its state").format(name)
            message = f"{state}; {self.trouble}" if level == ERROR else f"{state}: {hint}"
        return level, message, {**values, LIFECYCLE: state}

    def _progress(self) -> str:
        return self.progress() if self.active else ""

    def _hear(self, health: Health) -> None:
        if self._configured:
            self.hear(health)
