"""The parameter that all nodes of a graph share where not everyone may speak."""

from __future__ import annotations

from pydantic import Field

from pa_ros.core.settings import Settings


class Authenticated(Settings):
    """Settings of a process that signs what it says and checks what it hears, if it has a key."""

    auth_key_file: str = Field(
        "",
        description="key that all nodes share: sign, and refuse what isn't signed; empty: neither",
    )
