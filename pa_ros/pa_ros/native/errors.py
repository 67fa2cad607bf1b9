"""Errors of the native room."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class FusedError(PaError):
    """The fused engine cannot be loaded, or cannot take its arguments.

    The library raises it too, for sizes, types and registers that do not fit
    (pa_ros/native/bindings.cpp).
    """

    code = "learning.fused"
