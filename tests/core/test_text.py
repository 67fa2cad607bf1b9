"""Text: YAML from outside, and suggestions for misspelled names."""

import pytest
import yaml

from helpers.damage import WRONG_YAML
from pa_ros.core.text import did_you_mean
from pa_ros.core.yaml_text import read_yaml


@pytest.mark.parametrize("text", WRONG_YAML.values(), ids=WRONG_YAML.keys())
def test_what_is_wrong_is_a_value_error(text):
    with pytest.raises(ValueError, match=r"\S"):
        read_yaml(text)


def test_what_is_right_is_what_yaml_says():
    text = "a: &one [1, 2.5, true, null, x]\nb: *one\nd: 2024-01-13"
    assert read_yaml(text) == yaml.safe_load(text)
    assert read_yaml("") is None
    assert read_yaml("rate: 1e-4") == {"rate": 1e-4}  # as ROS reads it


def test_the_nearest_name_is_suggested() -> None:
    known = ["learner.updates.discount", "learner.updates.per_frame", *map(str, range(9))]
    for name in ("learner.updates.discont", "discount"):
        assert did_you_mean(name, known) == "; did you mean 'learner.updates.discount'?"
    assert did_you_mean("zzz", known) == ""
