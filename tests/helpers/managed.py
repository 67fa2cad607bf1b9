"""Somebody who changes the states of managed nodes, over their services."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from helpers.graph import Probe

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, SHUTDOWN = (
    Transition.TRANSITION_CONFIGURE,
    Transition.TRANSITION_CLEANUP,
    Transition.TRANSITION_ACTIVATE,
    Transition.TRANSITION_DEACTIVATE,
    Transition.TRANSITION_ACTIVE_SHUTDOWN,
)


class User:
    """Asks a node for transitions, over its services."""

    def __init__(self, probe: Probe, node: Any) -> None:
        self.probe, self.node, name = probe, node, node.get_name()
        self._change = probe.create_client(ChangeState, f"{name}/change_state")
        self._state = probe.create_client(GetState, f"{name}/get_state")
        self._set = probe.create_client(SetParameters, f"{name}/set_parameters")
        self.events: list[str] = []
        probe.create_subscription(
            TransitionEvent,
            f"{name}/transition_event",
            lambda event: self.events.append(event.goal_state.label),
            100,
        )

    def ask(self, number: int = 0, label: str = "") -> tuple[bool, str]:
        """Whether it came to pass, and the state then."""
        wanted = ChangeState.Request(transition=Transition(id=number, label=label))
        changed = self._call(self._change, wanted).success
        return changed, self._call(self._state, GetState.Request()).current_state.label

    def set(self, name: str, value: Any) -> str:
        """Why a parameter cannot be set; empty: it is."""
        return self._send(Parameter(name, value=value))

    def delete(self, name: str) -> str:
        """Why a parameter cannot be deleted; empty: it is."""
        return self._send(Parameter(name, Parameter.Type.NOT_SET))

    def _send(self, parameter: Parameter) -> str:
        request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
        (result,) = self._call(self._set, request).results
        return "" if result.successful else str(result.reason)

    def _call(self, client: Any, request: Any) -> Any:
        assert self.probe.until(client.service_is_ready)
        answer = client.call_async(request)
        assert self.probe.until(answer.done)
        return answer.result()
