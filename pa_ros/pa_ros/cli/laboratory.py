"""The way to the laboratory, which lies beside the package in a clone and is in no wheel."""

from __future__ import annotations

import importlib
from typing import Any

from pa_ros.core.errors import ConfigError


def import_command(module: str) -> Any:
    """Import a module. Raises ConfigError for one of a laboratory that is not there."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("laboratory"):
            raise
        raise ConfigError(
            "this needs the laboratory, which only a clone of the project has: run `make install` "
            "in a clone, and use its .venv/bin/pa_ros"
        ) from error
