"""How the page is served, and its addresses. Does not need the extra `console`."""

from __future__ import annotations

import os
import secrets
import socket
from typing import Literal

from pydantic import Field

from pa_ros.core.errors import ConfigError
from pa_ros.core.settings import Settings

HOST = "127.0.0.1"
# The token is passed on in a variable: every user of the host can read a command's arguments.
TOKEN = "PA_ROS_CONSOLE_TOKEN"


class ConsoleSettings(Settings):
    """How the page is served."""

    port: int = Field(8765, ge=0, le=65535, description="on 127.0.0.1; 0: any free port")
    token: str = Field("", description="in the address for sending programs; empty: a new one")
    light: Literal["full", "plain"] = Field(
        "full",
        description="plain: no reflections, which take a browser without a graphics card ten "
        "seconds",
    )


def new_token(settings: ConsoleSettings) -> str:
    """Return the token asked for, or a new one. Raises ConfigError if no address can contain it."""
    token = settings.token or os.environ.get(TOKEN) or secrets.token_urlsafe(16)
    if not (token.isascii() and token.replace("-", "").replace("_", "").isalnum()):
        raise ConfigError(f"token: expected ASCII letters, digits, - and _, got {token!r}")
    return token


def view_address(port: int) -> str:
    """Return the address of a page that shows everything and takes no input."""
    return f"http://{HOST}:{port}/"


def control_address(port: int, token: str) -> str:
    """Return the address of a page that can also send programs."""
    return f"{view_address(port)}?websocket=ws://{HOST}:{port}/{token}"


def free_port() -> int:
    """Return a port that is free now."""
    with socket.create_server((HOST, 0)) as probe:
        return int(probe.getsockname()[1])
