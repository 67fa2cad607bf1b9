"""Errors of the networks room; `code` says which kind each one is."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class NetworkError(PaError):
    """Tensors that do not fit a network, or a program that it cannot represent."""

    code = "networks.tensors"
