"""YAML from outside, of which nothing is known."""

from __future__ import annotations

import re
from typing import Any, Final

import yaml

DEEPEST: Final = 50  # levels of lists and mappings within each other
MOST: Final = 1_000_000  # values, those of an alias counted wherever it stands
_INTEGERS: Final = 1 << 64


class _Loader(yaml.SafeLoader):
    """YAML 1.2's floats, as ROS reads them: PyYAML takes 1e-4 for text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    [*"-+.0123456789"],
)


def read_yaml(text: str) -> Any:
    """What YAML says; ValueError if it isn't, or says what can't be written again: aliases that
    contain themselves, more than DEEPEST levels or MOST values, integers of more than 64 bits."""
    try:
        content = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    except Exception as error:  # whatever a value that is not of its tag leads PyYAML to
        raise ValueError(f"{type(error).__name__}: {error}") from error
    size, _ = _measured(content, 0, {})
    if size > MOST:
        raise ValueError(f"expected at most {MOST} values, got {size}")
    return content


def _measured(node: Any, depth: int, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Values of a node and its levels. ValueError for what read_yaml refuses of it."""
    if not isinstance(node, (dict, list, tuple, set)):
        return _checked(node), 0
    if id(node) not in known:
        _check_levels(depth)
        parts = [*node, *node.values()] if isinstance(node, dict) else [*node]
        inside = [_measured(part, depth + 1, known) for part in parts]
        size = 1 + sum(values for values, _ in inside)
        known[id(node)] = size, 1 + max((levels for _, levels in inside), default=0)
    _check_levels(depth + known[id(node)][1])
    return known[id(node)]


def _check_levels(levels: int) -> None:
    if levels > DEEPEST:
        raise ValueError(f"expected at most {DEEPEST} levels, got more, or one within itself")


def _checked(value: Any) -> int:
    if isinstance(value, int) and abs(value) >= _INTEGERS:
        raise ValueError(f"expected integers of 64 bits, got one of {value.bit_length()}")
    if isinstance(value, str):
        value.encode()  # no half of a pair
    return 1
