"""The web server: on this machine only, with a token for those who may send programs."""

from __future__ import annotations

import contextlib
import io
import os
import secrets
import socket
from collections.abc import Callable

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
        # viser does not pass on the address, but its connection has it.
        live = self.viser._websock_server._live_connections  # noqa: SLF001
        connection = live.get(client.client_id)
        path = "" if connection is None or connection.request is None else connection.request.path
        return secrets.compare_digest(path.strip("/").encode(), self.token.encode())

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
