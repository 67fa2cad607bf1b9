"""Serves the page, of a running graph or of a bag."""

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
from pa_ros.console.controls import Controls
from pa_ros.console.live import LiveConsole
from pa_ros.console.page import Page
from pa_ros.console.replay import Replay, Timeline
from pa_ros.console.server import ConsoleServer, attempt
from pa_ros.console.settings import ConsoleSettings
from pa_ros.ros.executor import node_beside, spin_until, steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.tools.client import client_node

Announce = Callable[[str, str], None]
"""Receives the address for sending programs, and the one for viewing only."""
PERIOD_S = 0.1  # between two updates of an open page
REFRESH_S = 1.0  # how often the offered examples, arenas and blocks are updated
VIEW_ONLY = (
    "This page is for viewing. To send programs, open the address with the token that was printed "
    "at the start."
)


class Visitors:
    """Gives controls to pages that were opened with the token."""

    def __init__(self, server: ConsoleServer, make: Callable[[viser.ClientHandle], object]) -> None:
        """`make` adds the controls to a page."""
        self._server, self._make = server, make
        self._lock = threading.Lock()  # viser calls on its own threads
        self._controls: dict[int, object] = {}
        server.viser.on_client_connect(self._add)
        server.viser.on_client_disconnect(self._remove)

    @property
    def controls(self) -> list[object]:
        """The controls of all pages that have some."""
        with self._lock:
            return list(self._controls.values())

    def _add(self, client: viser.ClientHandle) -> None:
        if not self._server.may_send(client):
            client.gui.add_html(markup.quiet(VIEW_ONLY), order=0)
            return
        made = self._make(client)
        with self._lock:
            self._controls[client.client_id] = made

    def _remove(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._controls.pop(client.client_id, None)


@contextmanager
def beside(node: Node, settings: ConsoleSettings, namespace: str = "") -> Iterator[ConsoleServer]:
    """Serve a page as long as the context lasts; it is updated while the node is spun."""
    with ConsoleServer(settings) as server:
        # Nobody spins this node: the steps of an arena are taken only when they are drawn.
        sampled = node_beside(node, "sampler")
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

        timer = steady_timer(node, PERIOD_S, tick)
        try:
            yield server
        finally:
            node.destroy_timer(timer)
            live.close()
            sampled.destroy_node()


def serve_graph(
    settings: ConsoleSettings, namespace: str, finished: Callable[[], bool], announce: Announce
) -> None:
    """Show a running graph until `finished`."""
    with client_node("console") as node, beside(node, settings, namespace) as server:
        announce(*server.addresses)
        spin_until(node, finished, None)


def serve_bag(
    path: Path,
    settings: ConsoleSettings,
    namespace: str | None,
    finished: Callable[[], bool],
    announce: Announce,
) -> None:
    """Show a recording until `finished`. Raises BagError if it cannot be shown."""
    with Bag(path) as bag, ConsoleServer(settings) as server:
        timeline = Timeline(Replay.read(bag, namespace), Page(server, learning=False))
        Visitors(server, timeline.add_controls)
        refusals = Refusals(partial(print, "pa_ros console:", file=sys.stderr, flush=True))
        announce(*server.addresses)
        while not finished():
            attempt(refusals, "timeline", lambda: timeline.tick(server.pages))
            time.sleep(PERIOD_S)
