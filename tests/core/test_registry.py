"""Registries: what is known by name, and refusals."""

from __future__ import annotations

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.core.registry import Registry


def test_items_are_found_in_the_order_of_registering() -> None:
    arms: Registry[float] = Registry("arm")
    assert arms.register("long", 2.0) == 2.0
    arms.register("short", 1.0)
    assert list(arms) == ["long", "short"] and arms["short"] == 1.0
    assert "long" in arms and "none" not in arms and len(arms) == 2


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    arms: Registry[float] = Registry("arm")
    arms.register("long", 2.0)
    with pytest.raises(ConfigError, match=r"^unknown arm: expected one of \['long'\], got 'x'$"):
        arms["x"]


def test_a_second_of_one_name_is_refused_and_the_same_again_is_not() -> None:
    arms: Registry[object] = Registry("arm")
    item = arms.register("long", object())
    assert arms.register("long", item) is item
    with pytest.raises(ConfigError, match="arm 'long': expected a name that is free"):
        arms.register("long", object())
    assert arms["long"] is item
