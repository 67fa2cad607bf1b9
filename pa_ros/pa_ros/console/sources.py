"""What the page subscribes to: the newest steps of an arena, and the weights of its agent."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from pa_ros.console.insight import Insight, agent_logic
from pa_ros.core.errors import PaError
from pa_ros.language import PRODUCT
from pa_ros.learning.checkpoints import load_policy
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import OBJECT_FEATURES, POLICY_WEIGHTS, PROVENANCE, Topic
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import decode_provenance
from pa_ros.wire.learning import decode_weights

DEPTH = 20  # steps kept between two looks: none is lost in real time at up to 20 times the speed
PERIOD_S = 5.0  # between two subscriptions to a learner's weights, which are large
LISTEN_S = 1.0  # how long such a subscription lasts


class Sampler:
    """Takes the newest control steps of an arena now and then, at no cost in between.

    Its subscription is best effort, so no arena waits for it, and no executor serves its node, so
    messages that are not taken cost no Python.
    """

    def __init__(
        self, node: Node, namespace: str, depth: int = DEPTH, steps: Topic = OBJECT_FEATURES
    ) -> None:
        """`node` must not be spun. `depth`: steps kept between two looks."""
        self._node, self._depth = node, depth
        profile = QoSProfile(
            reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depth
        )
        steps = replace(steps.within(f"/{namespace}"), reader=profile)
        self._reader = steps.subscribe(node, lambda _: None)

    def take(self) -> list[Message]:
        """Return the steps since the last call, in order."""
        return list(_waiting(self._reader, self._depth))

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._reader)


def _waiting(reader: Any, depth: int) -> Iterator[Message]:
    """Yield the messages waiting at a subscription, as an executor would take them."""
    for _ in range(depth):
        # No executor serves this subscription, so this takes from the queue of DDS itself.
        with reader.handle:
            found = reader.handle.take_message(reader.msg_type, False)
        if found is None:
            return
        yield found[0]


class AgentWeights:
    """The weights of the agent in a namespace, as far as they are known.

    They are those of the checkpoint that the agent's provenance names, or the newest of a learner.
    """

    def __init__(self, node: Node, namespace: str, refusals: Refusals) -> None:
        self._node, self._refusals = node, refusals
        self.insight: Insight | None = None
        self.why = ""  # why there is no insight
        self._topic = POLICY_WEIGHTS.within(f"/{namespace}")
        self._shown = ("", -1)  # learner and version
        self._source, self._logic = "", PRODUCT
        self._reader: Any = None
        self._since = -PERIOD_S
        provenance = PROVENANCE.within(f"/{namespace}")
        guarded = refusals.guard(provenance.name, self._on_provenance)
        self._origins = provenance.subscribe(node, guarded)

    def refresh(self) -> None:
        """Subscribe to a learner's weights for a moment, now and then; call it while a page is
        open."""
        now = time.monotonic()
        if self._source == "topic" and self._reader is None and now - self._since > PERIOD_S:
            guarded = self._refusals.guard(self._topic.name, self._on_weights)
            self._reader, self._since = self._topic.subscribe(self._node, guarded), now
        elif self._reader is not None and now - self._since > LISTEN_S:
            self.rest()

    def rest(self) -> None:
        """Unsubscribe from weights until the next refresh."""
        if self._reader is not None:
            self._node.destroy_subscription(self._reader)
            self._reader = None

    def close(self) -> None:
        """Unsubscribe from everything."""
        self.rest()
        self._node.destroy_subscription(self._origins)

    def _on_provenance(self, message: Message) -> None:
        parameters = decode_provenance(message).parameters
        if "checkpoint" not in parameters:
            return  # of another node
        self._source, path = str(parameters.get("weights")), str(parameters["checkpoint"])
        self._logic = agent_logic(parameters)
        if self._source == "checkpoint":
            try:
                self.insight, self.why = Insight(load_policy(Path(path)), self._logic), ""
            except PaError as error:
                self.insight, self.why = None, str(error)
        elif self._source == "random":
            self.insight, self.why = None, "the agent drew random weights, which it doesn't publish"

    def _on_weights(self, message: Message) -> None:
        policy = decode_weights(message)
        snapshot, (learner, version) = policy.snapshot, self._shown
        if policy.learner_id != learner or snapshot.version > version:
            self.insight, self.why = Insight(snapshot, self._logic), ""
            self._shown = policy.learner_id, snapshot.version
