"""Code of the operator's own, imported for what it registers.

An extension is a module (`a.b.c`) or a file (`path/x.py`) that puts arms, designs, relations … into
their registries. It is named on a command line or in a parameter, never by a message: nothing that
comes over a topic is ever imported.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import Field, model_validator

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.settings import Settings


class Extensible(Settings):
    """Settings of a node, whose other values may be names that extensions register."""

    extensions: tuple[str, ...] = Field(
        (), description="modules or files.py to import, for the arms, designs, … of your own"
    )

    @model_validator(mode="before")
    @classmethod
    def _load(cls, values: Any) -> Any:
        named = values.get("extensions", ()) if isinstance(values, dict) else ()
        if isinstance(named, (list, tuple)) and all(isinstance(name, str) for name in named):
            load(named)
        return values


def load(extensions: Iterable[str]) -> tuple[ModuleType, ...]:
    """Import extensions in order, each once; ConfigError names the one that cannot be, and why."""
    return tuple(map(_load, extensions))


def _load(extension: str) -> ModuleType:
    try:
        if extension.endswith(".py"):
            return _file(Path(extension).resolve())
        return importlib.import_module(extension)
    except PaError:
        raise
    except (Exception, SystemExit) as error:  # whatever code of others raises
        raise ConfigError(
            f"extension: expected a module or a file that can be imported, got {extension!r}: "
            f"{type(error).__name__}: {error}"
        ) from error


def _file(path: Path) -> ModuleType:
    name = f"pa_ros_extension_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None and spec.loader is not None  # it ends in .py
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]
