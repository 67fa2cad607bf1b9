"""Which weights the page shows."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

from helpers.learners import LEARNER, again, published
from pa_ros.console.weights import AgentWeights
from pa_ros.core.published import PublishedPolicy
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import POLICY_WEIGHTS, PROVENANCE
from pa_ros.wire.diagnostics import Origin, encode_provenance
from pa_ros.wire.learning import encode_weights


def test_the_newest_of_a_learner_is_shown_and_of_another_learner_its_first() -> None:
    heard: dict[str, Any] = {}
    node = Mock()
    node.create_subscription = lambda _, name, callback, *rest, **more: heard.update(
        {name.rpartition("/")[2]: callback}
    )
    weights = AgentWeights(node, "", Refusals(print))
    parameters = {"weights": "topic", "checkpoint": ""}
    origin = Origin("/agent_node", "a", "1", "{}", 0, parameters)
    heard[PROVENANCE.name](encode_provenance(origin))
    weights.attend()

    def hear(policy: PublishedPolicy) -> Any:
        heard[POLICY_WEIGHTS.name](encode_weights(policy))
        return weights.insight

    newest = hear(published(3000))
    assert newest is not None and hear(published(2999)) is newest
    other = again(LEARNER, 0)
    first = hear(published(0, learner=other))
    assert first is not newest and hear(published(0, learner=other)) is first
    assert hear(published(1, learner=other)) is not first
