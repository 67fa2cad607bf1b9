"""How the page is served, and its addresses. Does not need the extra `console`."""

from __future__ import annotations

import socket
from typing import Literal

from pydantic import Field

from pa_ros.core.settings import Settings

HOST = "127.0.0.1"
# A variable, because every user of the host can read a command's arguments.
TOKEN = "PA_ROS_CONSOLE_TOKEN"


class ConsoleSettings(Settings):
    """How the page is served."""

    port: int = Field(8765, ge=0, le=65535, description="on 127.0.0.1; 0: any free port")
    light: Literal["full", "plain"] = Field(
        "full",
        description="plain: no reflections, which take a browser without a graphics card ten "
        "seconds",
    )


def view_address(port: int) -> str:
    """The address of a page that shows everything and takes no input."""
    return f"http://{HOST}:{port}/"


def control_address(port: int, token: str) -> str:
    """The address of a page that can also send programs."""
    return f"{view_address(port)}?websocket=ws://{HOST}:{port}/{token}"


def free_port() -> int:
    """A port that is free now."""
    with socket.create_server((HOST, 0)) as probe:
        return int(probe.getsockname()[1])
