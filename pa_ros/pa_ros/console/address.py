"""Where a page is found; without the libraries that serve it."""

from __future__ import annotations

import socket

HOST = "127.0.0.1"
TOKEN = "PA_ROS_CONSOLE_TOKEN"  # a variable: what a command says, every user of the host reads


def looking(port: int) -> str:
    """Address of a page that may look."""
    return f"http://{HOST}:{port}/"


def sending(port: int, token: str) -> str:
    """Address of a page that may send, too."""
    return f"{looking(port)}?websocket=ws://{HOST}:{port}/{token}"


def free_port() -> int:
    """One that nobody has just now."""
    with socket.create_server((HOST, 0)) as probe:
        return int(probe.getsockname()[1])
