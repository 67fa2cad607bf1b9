"""Registries of arms, designs, relations …: items by name, to which extensions add theirs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

from pa_ros.core.errors import ConfigError
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
