"""YAML that is wrong in any way is a ValueError, and nothing else."""

from __future__ import annotations

import pytest
import yaml

from helpers.damage import WRONG_YAML
from pa_ros.core.yaml_text import read_yaml


@pytest.mark.parametrize("text", WRONG_YAML.values(), ids=WRONG_YAML.keys())
def test_what_is_wrong_is_a_value_error(text):
    with pytest.raises(ValueError, match=r"\S"):
        read_yaml(text)


def test_what_is_right_is_what_yaml_says():
    text = "a: &one [1, 2.5, true, null, x]\nb: *one\nc: 18446744073709551615\nd: 2024-01-13"
    assert read_yaml(text) == yaml.safe_load(text)
    assert read_yaml("") is None
