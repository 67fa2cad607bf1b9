"""Registries of arms, designs, relations …, the extensions that add to them, and settings of nodes.

An extension is a module (`a.b.c`) or a file (`path/x.py`) that adds arms, designs, relations … to
their registries. It is named on a command line or in a parameter, never by a message: nothing that
arrives over a topic is ever imported.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from pydantic import Field, model_validator

from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.settings import Settings
from pa_ros.core.text import did_you_mean

T = TypeVar("T")


OF_YOUR_OWN = "; if it is your own, load its file (--extension FILE, or the parameter extensions)"


class Registry(Generic[T]):
    """Items of one kind by name, in the order of registering; iterating gives names."""

    def __init__(self, kind: str) -> None:
        """`kind`: what an item is called in errors ("arm")."""
        self.kind = kind
        self._items: dict[str, T] = {}

    def register(self, name: str, item: T) -> T:
        """Add an item and return it; ConfigError if another item has the name."""
        if self._items.get(name, item) is not item:
            raise ConfigError(
                f"{self.kind} {name!r}: expected a new name, got one that is registered"
            )
        self._items[name] = item
        return item

    def __getitem__(self, name: str) -> T:
        """The item; ConfigError, with the known names, for an unknown name."""
        try:
            return self._items[name]
        except (KeyError, TypeError):  # a name that is not text
            raise ConfigError(
                f"unknown {self.kind}: expected one of {list(self)}, got {name!r}"
                f"{did_you_mean(str(name), self) or OF_YOUR_OWN}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)


class NodeSettings(Settings):
    """Settings that all nodes have; their other values may be names that extensions register.

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


def load(extensions: Iterable[str]) -> tuple[ModuleType, ...]:
    """Import extensions in order, each once; ConfigError names the one that failed, and why."""
    return tuple(map(_load, extensions))


def _load(extension: str) -> ModuleType:
    try:
        if extension.endswith(".py"):
            return _load_file(Path(extension).resolve())
        return importlib.import_module(extension)
    except PaError:
        raise
    except (Exception, SystemExit) as error:  # custom code may raise anything
        raise ConfigError(
            f"extension: expected a module or a file that can be imported, got {extension!r}: "
            f"{type(error).__name__}: {error}"
        ) from error


def _load_file(path: Path) -> ModuleType:
    # The path is part of the name, so that two files called x.py are two modules.
    name = f"pa_ros_extension_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None and spec.loader is not None  # the name ends in .py
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        # A module that failed half-way must not pass for a loaded one at the next attempt.
        except BaseException:
            del sys.modules[name]
            raise
    return sys.modules[name]
