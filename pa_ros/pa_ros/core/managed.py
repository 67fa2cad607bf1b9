"""The parameter that all managed nodes share."""

from __future__ import annotations

from pydantic import Field

from pa_ros.core.settings import Settings


class Managed(Settings):
    """Settings of a node with the standard lifecycle."""

    autostart: bool = Field(
        True,
        description="configured and activated at the start; false: waits, unconfigured, for "
        "transitions",
    )
