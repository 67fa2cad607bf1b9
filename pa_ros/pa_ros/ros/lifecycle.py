"""Managed nodes: the states, transitions and services of the ROS 2 lifecycle (docs/graph.md)."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from lifecycle_msgs import srv
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from pa_ros.core.clock import now_ns
from pa_ros.core.errors import PaError
from pa_ros.core.settings import Settings
from pa_ros.ros.actions import servers_of
from pa_ros.ros.executor import is_poll_timer
from pa_ros.ros.health import ERROR, LIFECYCLE, OK, WARN, HealthReporter
from pa_ros.ros.parameters import NodeParameters
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import SERVICE, Topic
from pa_ros.wire import Message
from pa_ros.wire.services import decode_transition
from pa_ros.wire.signing import SIGNED, Checker, Signer, read_key

RECEIVED_S = 1.0  # wall time in which the last messages of a node must arrive
LIFECYCLE_SERVICES = {
    "get_state": srv.GetState,
    "get_available_states": srv.GetAvailableStates,
    "get_available_transitions": srv.GetAvailableTransitions,
    "get_transition_graph": srv.GetAvailableTransitions,
}
HINTS = {
    "unconfigured": "waits to be configured (ros2 lifecycle set {} configure)",
    "inactive": "waits to be activated (ros2 lifecycle set {} activate)",
    "finalized": "was shut down: end the process and start it again",
}


class ManagedNode(LifecycleNode, ABC):
    """A lifecycle node that configures and activates itself, unless `autostart` is false.

    A subclass says what happens in `configure`, `activate`, `deactivate` and `cleanup`. All topics,
    services and timers that it made in or after `configure` are destroyed after `cleanup`; action
    servers stay, and reject goals until `configure` makes them again. A PaError rejects a
    transition: it is logged and counted or, at the start, raised. Other errors are bugs, and end
    the process.
    """

    config: Any  # settings, fixed while the node is configured
    active = False
    ended_by: PaError | None = None  # when a node sets this, its process ends with status 2

    def __init__(self, name: str, settings: type[Settings]) -> None:
        super().__init__(
            name,
            automatically_declare_parameters_from_overrides=True,
            enable_communication_interface=False,  # rcl's services lose requests: see SERVICE
        )
        self.refusals = Refusals(self.get_logger().warning)
        self.exit_status = 0  # of the process, if it ends without an error
        self._configured = False
        self._signer: Signer | None = None
        self._checker: Checker | None = None
        self._forged = 0  # messages without a valid signature, at the last report
        self._error: Exception | None = None  # that made the newest transition fail
        self._own_parameters: NodeParameters[Any] = NodeParameters(self, settings)
        self._health = HealthReporter(self, self.refusals, self._report, self._progress)
        self._change_state = self._LifecycleNodeMixin__on_change_state
        for path, kind in LIFECYCLE_SERVICES.items():
            answer = getattr(self, f"_LifecycleNodeMixin__on_{path}")
            self.create_service(kind, f"~/{path}", answer)
        self.create_service(srv.ChangeState, "~/change_state", self._on_change_state)
        # These exist in every state: parameter and lifecycle services, diagnostics.
        self._permanent = {id(entity) for _, entity in self._entities()}
        if self.get_parameter("autostart").value is not False:
            for trigger in (self.trigger_configure, self.trigger_activate):
                trigger()
                self._raise_error()

    # For subclasses to implement

    def configure(self) -> None:
        """Build everything from `config`; the node is not active yet."""

    def activate(self) -> None:
        """Start, or resume; `active` is already true."""

    def deactivate(self) -> None:
        """Stop; `active` is already false. Messages that arrive from now on change nothing."""

    def cleanup(self) -> None:
        """Save and close what `configure` opened; the node is not active."""

    def shutdown(self) -> None:
        """End a configured node, whether it is active or not."""
        if self.active:
            self.active = False
            self.deactivate()
        self.cleanup()

    @abstractmethod
    def collect(self) -> tuple[int, str, dict[str, str]]:
        """Level, message and values for /diagnostics; called while configured."""

    @property
    def trouble(self) -> str:
        """An ERROR to report even while inactive; empty if there is none."""
        return ""

    def progress(self) -> str:
        """A line for the log every few seconds while active; empty for no line."""
        return ""

    # For subclasses to use in `configure`

    def create_service(self, *given: Any, qos_profile: Any = SERVICE, **named: Any) -> Any:
        """A service that loses no request, however many arrive at once."""
        return super().create_service(*given, qos_profile=qos_profile, **named)

    def advertise(self, topic: Topic) -> Any:
        """A publisher. It signs its messages if the node has a key and the topic is signed."""
        publisher, signer = topic.publisher(self), self._signer
        if signer is not None and topic.type in SIGNED:
            publish, name = publisher.publish, publisher.topic_name
            publisher.publish = lambda message: publish(signer.sign(name, message))
        return publisher

    def subscribe(self, topic: Topic, callback: Callable[[Message], None]) -> Any:
        """Call back with each message; a PaError refuses it.

        If the node has a key and the topic is signed, messages with a wrong signature are refused.
        """
        checker, handle = self._checker, callback
        if checker is not None and topic.type in SIGNED:
            name = self.resolve_topic_name(topic.name)

            def check_and_handle(message: Message) -> None:
                checker.check(name, message)
                callback(message)

            handle = check_and_handle
        return topic.subscribe(self, self.refusals.guard(topic.name, handle))

    # The state machine

    @property
    def state(self) -> str:
        """The lifecycle state: "unconfigured", "inactive", "active" or "finalized"."""
        return str(self._state_machine.current_state[1])

    def close(self) -> int:
        """Shut down from any state; the exit status of the process. Destroy the node afterwards."""
        if self.state != "finalized":
            self.trigger_shutdown()
            self._raise_error()
        return self.exit_status

    def destroy_node(self) -> None:
        for server in servers_of(self):  # rclpy forgets to destroy these
            server.destroy()
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.active = False
        return self._attempt(self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(lambda: self._end(self.cleanup))

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt(lambda: self._end(self.shutdown))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Save what can be saved after a bug; the process then ends with the bug's traceback."""
        try:
            self._end(self.shutdown)
        except Exception as error:
            self.get_logger().error(f"shutdown after an error failed, too: {error!r}")
        return TransitionCallbackReturn.SUCCESS

    def _attempt(self, transition: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy swallows exceptions of transitions, so the error is kept for `_raise_error`.
        self._error = None
        try:
            transition()
        except PaError as error:
            self._error = error
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self._error = error
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _raise_error(self) -> None:
        """Raise the error of the newest transition, if it failed."""
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _configure(self) -> None:
        try:
            self.config = self._own_parameters.fix()
            self._signer = self._checker = None
            if self.config.auth_key_file:
                key = read_key(Path(self.config.auth_key_file))
                self._signer = Signer(key, self.get_fully_qualified_name(), now_ns())
                self._checker = Checker(key)
            self.configure()
        except BaseException:
            self._destroy_configured()
            raise
        self._configured = True

    def _activate(self) -> None:
        self.active = True
        try:
            self.activate()
        except BaseException:
            self.active = False
            raise

    def _end(self, how: Callable[[], None]) -> None:
        configured, self._configured = self._configured, False
        try:
            if configured:
                how()
                self._wait_until_received()
        finally:
            self.active = False
            self._destroy_configured()

    def _wait_until_received(self) -> None:
        """Wait until reliable subscribers have what was published, at most RECEIVED_S: a publisher
        that is destroyed sends nothing again."""
        deadline = time.monotonic() + RECEIVED_S
        with suppress(RuntimeError):  # rcl's own, of a middleware that cannot tell
            for publisher in self.publishers:
                left = max(deadline - time.monotonic(), 0.0)
                publisher.wait_for_all_acked(Duration(seconds=left))

    def _destroy_configured(self) -> None:
        """Destroy what was made since `configure`; parameters may be set again."""
        # rclpy makes its subscription to /clock whenever `use_sim_time` is set.
        on_clock = self._time_source.clock_callback
        for destroy, entity in [*self._entities()]:
            of_clock = getattr(entity, "callback", None) == on_clock
            permanent = id(entity) in self._permanent or of_clock
            if not permanent and not is_poll_timer(entity):
                destroy(entity)
        # rclpy never removes what it destroys from its callback group.
        group: Any = self.default_callback_group
        group.entities = {entity for entity in group.entities if entity() is not None}
        for server in servers_of(self):
            server.rest()
        self._own_parameters.open()

    def _entities(self) -> Iterator[tuple[Callable[[Any], Any], Any]]:
        """All timers, services, subscriptions and publishers, each with what destroys it.

        Timers come first: they may use the others.
        """
        yield from ((self._destroy_timer, timer) for timer in self.timers)
        yield from ((self.destroy_service, service) for service in self.services)
        yield from ((self.destroy_subscription, one) for one in self.subscriptions)
        yield from ((self.destroy_publisher, publisher) for publisher in self.publishers)

    def _destroy_timer(self, timer: Any) -> None:
        # The executor may already have queued a call of the timer. It must find nothing to do,
        # since the publishers that the callback uses are destroyed next.
        timer.callback = lambda: None
        self.destroy_timer(timer)

    def _on_change_state(self, request: Message, response: Any) -> Any:
        """Serve `change_state`. rclpy's own service ends the node for an impossible transition."""
        number, label = decode_transition(request)
        possible = {t[1]: t[0] for t in self._state_machine.available_transitions}
        names = [n for n, t in possible.items() if (n == label if label else t == number)]
        try:
            if not names:
                raise PaError(
                    f"transition: expected one of {sorted(possible)} from the state {self.state}, "
                    f"got {label or number!r}",
                    code="lifecycle.transition",
                )
            response = self._change_state(request, response)
            self._raise_error()
            self.get_logger().info(f"{names[0]}: now {self.state}")
        except PaError as error:
            self.refusals.refuse("change_state", error)
        finally:
            self._health.publish()
        return response

    # Health

    def _report(self) -> tuple[int, str, dict[str, str]]:
        level, message, values = self.collect() if self._configured else (WARN, "", {})
        before, self._forged = self._forged, self._count_forged()
        if level == OK and self._forged > before:
            level, message = WARN, f"rejected {self._forged - before} messages without a valid "
            message += "signature (see the log): stop their sender, or give it the key"
        state = self.state
        if not self.active and self._configured and self.trouble:
            level, message = ERROR, f"{state}; {self.trouble}"
        elif not self.active:
            hint = HINTS.get(state, "changes its state").format(self.get_fully_qualified_name())
            level, message = WARN, f"{state}: {hint}"
        return level, message, {**values, LIFECYCLE: state}

    def _count_forged(self) -> int:
        counts = self.refusals.counts
        return sum(count for code, count in counts.items() if code.startswith("auth."))

    def _progress(self) -> str:
        return self.progress() if self.active else ""
