"""YAML from outside: parameter files, metadata of bags."""

from __future__ import annotations

import re
from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """YAML 1.2's floats, as ROS reads them, and no name twice: PyYAML takes 1e-4 for text, and
    ignores the first of two equal names."""

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        names = set()
        for key, _ in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            if name in names:
                raise yaml.YAMLError(f"line {line}: expected each name once, got {name!r} twice")
            names.add(name)
        return node


_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, [*"-+.0123456789"])


def read_yaml(text: str) -> Any:
    """The value of a YAML text; ValueError if it is not YAML."""
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
    except Exception as error:  # PyYAML fails in many ways for a value that is not of its tag
        raise ValueError(f"{type(error).__name__}: {error}") from error
