"""A connection to a running graph: a node that a thread serves, while other threads wait."""

from __future__ import annotations

import atexit
import logging
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.action import ActionClient

from pa_ros.core.errors import ConfigError
from pa_ros.ros.actions import EXECUTE_PROGRAM, GOALS, SIMULATE_STEPS
from pa_ros.ros.executor import spin_until
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import OBJECT_FEATURES
from pa_ros.tools.client import (
    ArenaClient,
    NoAnswerError,
    client_node,
    namespaces_of_arenas,
    publishers_of,
)
from pa_ros.tools.domain import DomainClaim
from pa_ros.tools.graph import start_nodes
from pa_ros.tools.launch_params import Parameters
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import GraphFigures, watch_diagnostics
from pa_ros.tools.scenes import SceneMonitor
from pa_ros.tools.weights import AgentWeights
from pa_ros.wire import Message
from pa_ros.wire.services import is_any_active

log = logging.getLogger(__name__)

NOTICE_S = 3.0
DISCOVERY_S = 3.0  # until the nodes of a graph have discovered each other
POLL_S = 0.01


class Connection:
    """A node with ROS of its own, the thread that serves it, and what it needs of an arena."""

    def __init__(self, namespace: str, patience: float, domain: int | DomainClaim | None) -> None:
        """
        :param patience: longest wait for an answer, s.
        :param domain: the ROS domain; None: ROS_DOMAIN_ID, or 0. A claim ends with the connection.
        """
        self.patience, self._since = patience, time.monotonic()
        self._children: Supervisor | None = None
        with ExitStack() as stack:
            if isinstance(domain, DomainClaim):
                domain = stack.enter_context(domain).number
            self.node = node = stack.enter_context(client_node("arm", namespace, domain))
            self.domain, self.namespace = node.context.get_domain_id(), node.get_namespace()
            self.monitor, self._figures = SceneMonitor(node), GraphFigures()
            watch_diagnostics(node, self._figures)
            self.weights = AgentWeights(node, self.namespace.strip("/"), Refusals(log.warning))
            self.services = ArenaClient(node, patience, self.until)
            self.goals: Any = ActionClient(node, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0])
            stack.callback(self.goals.destroy)
            self.executing = False  # whether the agent works on a goal of any client
            GOALS.subscribe(node, self._on_goals)
            self.steps: Any = ActionClient(node, SIMULATE_STEPS[1], SIMULATE_STEPS[0])
            stack.callback(self.steps.destroy)
            stop = threading.Event()
            serve = partial(spin_until, node, stop.is_set, None)
            thread = threading.Thread(target=serve, name="arm", daemon=True)
            thread.start()
            stack.callback(thread.join)
            stack.callback(stop.set)
            self._stack = stack.pop_all()
        # Python must not end while the thread runs C++.
        atexit.register(self.close)

    def start(
        self, parameters: Parameters, record: str | Path | None, logs: str | Path | None
    ) -> None:
        """Start nodes in another process, which ends with the connection."""
        enter = self._stack.enter_context
        folder = Path(logs or enter(tempfile.TemporaryDirectory(prefix="pa_ros-")))
        if record is not None:
            from pa_ros.tools.record import Recorder

            enter(Recorder(Path(record), self.node))
        self._children = enter(Supervisor(folder, {"ROS_DOMAIN_ID": str(self.domain)}))
        start_nodes(self._children, parameters, folder, compose=True)

    def _on_goals(self, message: Message) -> None:
        self.executing = is_any_active(message)

    def join(self) -> None:
        """Wait for an arena. Raises NoAnswerError or ConfigError, which say what to do."""
        seen = lambda: self.monitor.scene is not None  # noqa: E731
        before_notice_s = min(NOTICE_S, self.patience)
        if self.until(seen, before_notice_s):
            return
        found = namespaces_of_arenas(self.node)
        if found and self.namespace not in found:
            raise ConfigError(
                f"namespace: expected one with an arena ({', '.join(found)}), got {self.namespace}"
            )
        where = f"ROS domain {self.domain}, namespace {self.namespace}"
        if not found and self.patience > before_notice_s and self._children is None:
            text = f"no arena yet in {where}: waits for one, {self.patience:g} s at most"
            print(text, file=sys.stderr, flush=True)
        if self.until(seen, self.patience - before_notice_s):
            return
        if (arena := self.monitor.arena) is not None:
            raise NoAnswerError(
                f"arena {arena.arena_id} describes itself, but no observation of it arrived within "
                f"{self.patience:g} s: {self.standstill()}",
                code="arm.silent_arena",
            )
        raise NoAnswerError(
            f"no arena within {self.patience:g} s in {where}: start one (`pa_ros launch`, or "
            "Arm.simulated()), or choose the domain (ROS_DOMAIN_ID) and namespace of yours",
            code="arm.no_arena",
        )

    def standstill(self) -> str:
        """Why the arena's time stands still: what the nodes that publish its steps say."""
        nodes = sorted(publishers_of(self.node, OBJECT_FEATURES))
        if not nodes:
            return f"no node publishes {OBJECT_FEATURES.name}: has sim_node or robot_node ended?"
        return "; ".join(map(self._figures.message, nodes))

    def agent_takes_goals(self) -> bool:
        """Whether an agent is known that takes goals."""
        return bool(self.goals.server_is_ready())

    def discovered(self, condition: Callable[[], bool]) -> bool:
        """Whether a condition holds. Shortly after joining it may only seem not to, because nodes
        were not discovered yet: then wait for it."""
        return self.until(condition, max(self._since + DISCOVERY_S - time.monotonic(), 0.0))

    def until(self, condition: Callable[[], bool], timeout_s: float | None = None) -> bool:
        """Wait for a condition, for `patience` unless given; whether it became true in time.

        Raises ChildError if a process that was started here has ended.
        """
        deadline = time.monotonic() + (self.patience if timeout_s is None else timeout_s)
        while not condition():
            if self._children is not None:
                self._children.check()
            if time.monotonic() > deadline:
                return False
            time.sleep(POLL_S)
        return True

    def call(self, act: Callable[[], Any]) -> Any:
        """The result of a function that runs in the node's thread.

        rclpy's action client, for one, loses an answer that arrives while another thread is still
        in `send_goal_async`.
        """
        task = self.node.executor.create_task(act)
        if not self.until(task.done):
            raise NoAnswerError(f"the node's thread did not answer within {self.patience:g} s")
        return task.result()

    def close(self) -> None:
        """Leave the graph, and end what was started."""
        atexit.unregister(self.close)
        self._stack.close()


class Lease:
    """What an arm and its goals hold: the connection is closed once all of them are forgotten.

    A notebook's cell that runs again forgets the arm of its last run.
    """

    def __init__(self, graph: Connection) -> None:
        # Whichever thread forgets the arm, perhaps the connection's own, must not wait here.
        closing = threading.Thread(target=graph.close, name="forgotten arm")
        weakref.finalize(self, closing.start).atexit = False  # then `graph` closes by itself
