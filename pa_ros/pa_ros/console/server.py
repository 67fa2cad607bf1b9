"""The web server: on this machine alone, nothing from outside, and who may send."""

from __future__ import annotations

import contextlib
import io
import os
import secrets
import socket
from typing import Literal

import viser
from pydantic import Field

from pa_ros.console.address import HOST, TOKEN, looking, sending
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.settings import Settings


class ConsoleSettings(Settings):
    """How the page is served."""

    port: int = Field(8765, ge=0, le=65535, description="on 127.0.0.1; 0: one that is free")
    rate_hz: float = Field(10.0, ge=0.5, le=30, description="how often an open page is renewed")
    token: str = Field("", description="in the address of who may send; empty: a new one")
    light: Literal["full", "plain"] = Field(
        "full",
        description="plain: no reflections, which a browser without a graphics card needs ten "
        "seconds for",
    )


class PortError(PaError):
    """Somebody has the port."""

    code = "console.port"


class ConsoleServer:
    """A viser server with a token. A context manager."""

    def __init__(self, settings: ConsoleSettings) -> None:
        """Raises PortError if the port is taken, ConfigError for a token that no address holds."""
        self.token = settings.token or os.environ.get(TOKEN) or secrets.token_urlsafe(16)
        if not (self.token.isascii() and self.token.replace("-", "").replace("_", "").isalnum()):
            raise ConfigError(f"token: expected ASCII letters, digits, - and _, got {self.token!r}")
        self.reflections = settings.light == "full"
        _check_free(settings.port)
        with contextlib.redirect_stdout(io.StringIO()):  # its banner has no token in its address
            self.viser = viser.ViserServer(HOST, settings.port, "pa_ros console", verbose=False)
        if settings.port and self.viser.get_port() != settings.port:
            self.viser.stop()
            raise PortError(_taken(settings.port))
        # A page could ask for a tunnel to viser's own host: nothing leaves this machine.
        self.viser.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
        gui = self.viser.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()

    @property
    def watching(self) -> str:
        """Address of a page that may look."""
        return looking(self.viser.get_port())

    @property
    def address(self) -> str:
        """Address of a page that may send, too."""
        return sending(self.viser.get_port(), self.token)

    @property
    def pages(self) -> int:
        """How many are open."""
        return len(self.viser.get_clients())

    def may_send(self, client: viser.ClientHandle) -> bool:
        """Whether a page came with the token: viser hands on no path, its connection has it."""
        live = self.viser._websock_server._live_connections  # noqa: SLF001
        connection = live.get(client.client_id)
        path = "" if connection is None or connection.request is None else connection.request.path
        return secrets.compare_digest(path.strip("/").encode(), self.token.encode())

    def __enter__(self) -> ConsoleServer:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


def _check_free(port: int) -> None:
    """viser would take the next free port in silence."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise PortError(_taken(port)) from error


def _taken(port: int) -> str:
    return f"port {port} of {HOST} is in use: choose another with --port (0: one that is free)"
