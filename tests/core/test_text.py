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


@pytest.mark.parametrize("text", ["a: 1\nb: 2\na: 1", "b: {a: 1, c: [],\n\n a: 2}"])
def test_a_name_that_stands_twice_is_an_error_with_its_line(text):
    with pytest.raises(ValueError, match="^line 3: expected each name once, got 'a' twice$"):
        read_yaml(text)
    assert read_yaml("a: &a {x: 1}\nb: &b {<<: *a, x: 2}\nc: {<<: *b}")["c"] == {"x": 2}


def test_the_nearest_name_is_suggested() -> None:
    known = ["learner.updates.discount", "learner.updates.per_frame", *map(str, range(9))]
    for name in ("learner.updates.discont", "discount"):
        assert did_you_mean(name, known) == "; did you mean 'learner.updates.discount'?"
    assert did_you_mean("zzz", known) == ""
