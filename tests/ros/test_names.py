"""What a namespace is: what ROS takes for one, of settings and of what people type."""

from __future__ import annotations

import pytest

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from pa_ros.core.errors import ConfigError
from pa_ros.ros.environment import check_namespace

GOOD = ("", "/", "a", "/a", "a/b_1", "/_a/B2/c", "a" * 200)
BAD = ("a b", "//x", "a//b", "~foo", "~", "~/a", "{node}", "1a", "a/1b", "a-b", "ä", "٣", "a\n",
       "a\0", "a" * 201)  # fmt: skip


@pytest.mark.parametrize("text", GOOD)
def test_what_ros_can_have_as_a_namespace_is_one(text: str) -> None:
    check_namespace(text)
    assert AgentConfig(learner=text).learner == text
    assert LearnerNodeConfig(arenas=(text, "other")).arenas == (text, "other")


@pytest.mark.parametrize("text", [*BAD, "a/"])
def test_anything_else_is_refused_and_shown(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^--namespace: expected .*, got '") as refused:
        check_namespace(text, "--namespace")
    assert repr(text) in str(refused.value)


@pytest.mark.parametrize("text", BAD)
def test_settings_that_name_a_namespace_refuse_it(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^learner: expected a namespace"):
        AgentConfig(learner=text)
    with pytest.raises(ConfigError, match=r"^arenas: expected a namespace"):
        LearnerNodeConfig(arenas=("a", text))


def test_a_setting_may_end_its_namespace_with_a_slash() -> None:
    assert AgentConfig(learner="lab/").learner == "lab/"
