"""Settings of learning that contradict each other, or name nothing, are rejected in one line."""

from typing import Any

import pytest

from pa_ros.core.errors import ConfigError
from pa_ros.learning.config import RelabelingConfig
from pa_ros.learning.recipes import LearningSettings


def test_several_programs_need_relabeling() -> None:
    assert RelabelingConfig(rule="all-goals", programs_per_transition=2)
    with pytest.raises(ConfigError, match="expected 1 without relabeling, got 2"):
        RelabelingConfig(programs_per_transition=2)


@pytest.mark.parametrize("name", ["recipe", "algorithm"])
def test_a_name_that_is_no_text_is_rejected(name: str) -> None:
    values: dict[str, Any] = {name: {}}
    with pytest.raises(ConfigError, match=rf"{name}: expected one of \[.*\], got {{}}"):
        LearningSettings(**values)
