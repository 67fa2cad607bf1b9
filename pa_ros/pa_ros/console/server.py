"""The web server: on this machine only, with a token for those who may send programs."""

from __future__ import annotations

import contextlib
import io
import os
import secrets
import socket
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import viser

from pa_ros.console.settings import (
    HOST,
    TOKEN,
    ConsoleSettings,
    control_address,
    view_address,
)
from pa_ros.core.errors import PaError
from pa_ros.ros.refusals import Refusals

FOREIGN = 1008  # the code by which a websocket is closed: policy violation


class ConsoleError(PaError):
    """A page that cannot be served (console.port), or a request that cannot be carried out."""

    code = "console"


class ConsoleServer:
    """A viser server with a token. A context manager."""

    def __init__(self, settings: ConsoleSettings) -> None:
        """Raises ConsoleError if the port is taken."""
        self.token = os.environ.get(TOKEN) or secrets.token_urlsafe(16)
        self.reflections = settings.light == "full"
        _check_free(settings.port)
        with contextlib.redirect_stdout(io.StringIO()):  # its banner shows an address without token
            self.viser = viser.ViserServer(HOST, settings.port, "pa_ros console", verbose=False)
        # viser could open a tunnel to a public host for a page. Nothing may leave this machine.
        self.viser.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
        # Before viser's own, so that nothing was sent yet.
        self.viser._websock_server._client_connect_cb.insert(0, self._refuse_foreign)  # noqa: SLF001
        gui = self.viser.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()

    @property
    def addresses(self) -> tuple[str, str]:
        """Address of a page that can send programs, and of one that takes no input."""
        port = self.viser.get_port()
        return control_address(port, self.token), view_address(port)

    @property
    def pages(self) -> int:
        """How many pages are open."""
        return len(self.viser.get_clients())

    def may_send(self, client: viser.ClientHandle) -> bool:
        """Whether a page was opened with the token."""
        connection = self._connection(client.client_id)
        path = "" if connection is None or connection.request is None else connection.request.path
        return secrets.compare_digest(path.strip("/").encode(), self.token.encode())

    async def _refuse_foreign(self, client: Any) -> None:
        """Close the connection of a page from elsewhere, which a browser here may have open: any
        page may connect to this machine, but the browser says where the page is from."""
        connection = self._connection(client.client_id)
        headers = connection.request.headers
        origin = headers.get("Origin")  # programs that are no browser send none
        if origin and urlsplit(origin).netloc != headers.get("Host"):
            await connection.close(FOREIGN, "expected a page of this server")

    def _connection(self, client_id: int) -> Any:
        """A page's websocket; viser does not pass on its address and headers, but it has them."""
        return self.viser._websock_server._live_connections.get(client_id)  # noqa: SLF001

    def __enter__(self) -> ConsoleServer:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


def attempt(refusals: Refusals, what: str, act: Callable[[], object]) -> None:
    """Do what a page asked for; count and log any error, so that the other pages continue.

    viser passes on whatever a page sends, so a value may be none of those it was offered.
    """
    try:
        act()
    except PaError as error:
        refusals.refuse(what, error)
    except Exception as error:
        refusals.refuse(what, ConsoleError(f"{type(error).__name__}: {error}"))


def _check_free(port: int) -> None:
    """Raise ConsoleError if a port is taken; viser would silently take the next one."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise ConsoleError(
                f"port {port} of {HOST} is in use: choose another with --port (0: any free port)",
                code="console.port",
            ) from error
