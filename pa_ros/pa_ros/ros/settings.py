"""Settings that all nodes have."""

from __future__ import annotations

from typing import Any

from pydantic import Field, model_validator

from pa_ros.core.extensions import load
from pa_ros.core.settings import Settings


class NodeSettings(Settings):
    """Base of every node's settings, whose values may be names that extensions register.

    Name it first among several bases, so that extensions are imported before names are checked.
    """

    extensions: tuple[str, ...] = Field(
        (), description="modules or files.py to import, for custom arms, designs, …"
    )
    auth_key_file: str = Field(
        "",
        description="file with the key that all nodes share: sign messages, and reject unsigned "
        "ones; empty: neither",
    )
    autostart: bool = Field(
        True,
        description="configure and activate at the start; false: wait for lifecycle transitions",
    )

    @model_validator(mode="before")
    @classmethod
    def _load_extensions(cls, values: Any) -> Any:
        named = values.get("extensions", ()) if isinstance(values, dict) else ()
        if isinstance(named, (list, tuple)) and all(isinstance(name, str) for name in named):
            load(named)
        return values
