"""Things by name, to which anyone may add: rewards, relations, arms, algorithms."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

from pa_ros.core.errors import ConfigError

T = TypeVar("T")


class Registry(Generic[T]):
    """Items of one kind by name, in the order of registering; iterating gives names."""

    def __init__(self, kind: str) -> None:
        """`kind`: what an item is called in refusals ("arm")."""
        self.kind = kind
        self._items: dict[str, T] = {}

    def register(self, name: str, item: T) -> T:
        """Add an item, and return it; ConfigError if the name is another's already."""
        if self._items.get(name, item) is not item:
            raise ConfigError(f"{self.kind} {name!r}: expected a name that is free, got a second")
        self._items[name] = item
        return item

    def __getitem__(self, name: str) -> T:
        """ConfigError, with the known names, for a name that is none."""
        try:
            return self._items[name]
        except (KeyError, TypeError):  # a name is text
            raise ConfigError(
                f"unknown {self.kind}: expected one of {list(self)}, got {name!r}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)
