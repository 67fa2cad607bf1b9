"""Serving the page: beside a node that is spun, or of a bag."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import viser
from rclpy.node import Node

from pa_ros.bags.reader import Bag
from pa_ros.console import markup
from pa_ros.console.asked import attempt
from pa_ros.console.controls import Controls
from pa_ros.console.live import LiveConsole
from pa_ros.console.page import Page
from pa_ros.console.recorded import Replay
from pa_ros.console.replay import Timeline
from pa_ros.console.server import ConsoleServer, ConsoleSettings
from pa_ros.ros.executor import spin_until, steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.tools.client import client_node

Announce = Callable[[str, str], None]
"""Told the address of who may send, and that of who may look."""
REFRESH_S = 1.0  # of what controls offer


class Visitors:
    """Pages that came with the token have controls; the others are told that they may look."""

    def __init__(self, server: ConsoleServer, make: Callable[[viser.ClientHandle], object]) -> None:
        self._server, self._make = server, make
        self._lock = threading.Lock()
        self._controls: dict[int, object] = {}
        server.viser.on_client_connect(self._come)
        server.viser.on_client_disconnect(self._go)

    @property
    def controls(self) -> list[object]:
        """Of all pages that have some."""
        with self._lock:
            return list(self._controls.values())

    def _come(self, client: viser.ClientHandle) -> None:
        if not self._server.may_send(client):
            client.gui.add_html(
                markup.quiet("This page may look. To send programs, open the address that was "
                             "printed at the start, with its token."), order=0,
            )  # fmt: skip
            return
        made = self._make(client)
        with self._lock:
            self._controls[client.client_id] = made

    def _go(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._controls.pop(client.client_id, None)


@contextmanager
def beside(node: Node, settings: ConsoleSettings, namespace: str = "") -> Iterator[ConsoleServer]:
    """A page for as long as the context lasts, renewed whenever somebody spins the node."""
    import rclpy

    with ConsoleServer(settings) as server:
        sampled = rclpy.create_node(
            f"{node.get_name()}_sampler", enable_rosout=False, start_parameter_services=False
        )
        live = LiveConsole(node, sampled, Page(server), namespace)
        visitors = Visitors(server, lambda client: Controls(client, live))
        refreshed, refusals = [0.0], Refusals(node.get_logger().warning)

        def tick() -> None:
            live.tick(server.pages)
            if time.monotonic() - refreshed[0] > REFRESH_S:
                refreshed[0] = time.monotonic()
                for controls in visitors.controls:
                    if isinstance(controls, Controls):
                        attempt(refusals, "controls", controls.refresh)

        timer = steady_timer(node, 1.0 / settings.rate_hz, tick)
        try:
            yield server
        finally:
            node.destroy_timer(timer)
            sampled.destroy_node()


def serve_graph(
    settings: ConsoleSettings, namespace: str, finished: Callable[[], bool], announce: Announce
) -> None:
    """Show a running graph until `finished`."""
    with client_node("console") as node, beside(node, settings, namespace) as server:
        announce(server.address, server.watching)
        spin_until(node, finished, None)


def serve_bag(
    path: Path,
    settings: ConsoleSettings,
    namespace: str | None,
    finished: Callable[[], bool],
    announce: Announce,
) -> None:
    """Show a recording until `finished`. Raises what `Bag` and `Replay` do."""
    with Bag(path) as bag:
        replay = Replay(bag, namespace)
        with ConsoleServer(settings) as server:
            page = Page(server, learning=False)
            timeline = Timeline(replay, page)
            Visitors(server, timeline.controls)
            refusals = Refusals(partial(print, "pa_ros console:", file=sys.stderr, flush=True))
            announce(server.address, server.watching)
            while not finished():
                attempt(refusals, "timeline", lambda: timeline.tick(server.pages))
                time.sleep(1.0 / settings.rate_hz)
