"""Namespaces: what ROS accepts, in settings and in what people type."""

import pytest

from agent_node.config import AgentConfig
from learner_node.config import LearnerNodeConfig
from pa_ros.core.errors import ConfigError
from pa_ros.ros.environment import check_namespace

BAD = ("a b", "//x", "~foo", "{node}", "a/1b", "a-b", "ä", "a\n", "a" * 201)


@pytest.mark.parametrize("text", ["", "/", "/a", "a/b_1", "/_a/B2/c", "a" * 200])
def test_a_namespace_that_ros_accepts_is_accepted(text: str) -> None:
    check_namespace(text)
    assert AgentConfig(learner=text).learner == text
    assert LearnerNodeConfig(arenas=(text, "other")).arenas == (text, "other")


@pytest.mark.parametrize("text", BAD)
def test_an_invalid_namespace_is_rejected_and_shown(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^--namespace: expected .*, got '") as refused:
        check_namespace(text, "--namespace")
    assert repr(text) in str(refused.value)
    with pytest.raises(ConfigError, match=r"^learner: expected a namespace"):
        AgentConfig(learner=text)
    with pytest.raises(ConfigError, match=r"^arenas: expected a namespace"):
        LearnerNodeConfig(arenas=("a", text))
