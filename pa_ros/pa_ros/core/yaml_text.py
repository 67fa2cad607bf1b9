"""YAML from outside: parameter files, metadata of bags."""

from __future__ import annotations

import re
from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """YAML 1.2's floats, as ROS reads them: PyYAML takes 1e-4 for text."""


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
