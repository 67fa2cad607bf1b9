"""Which weights act, so that the page can say what they make of a program."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.node import Node

from pa_ros.console.insight import Insight, logic_of
from pa_ros.console.sampler import within
from pa_ros.core.errors import PaError
from pa_ros.language import PRODUCT
from pa_ros.learning.checkpoints import load_policy
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import POLICY_WEIGHTS, PROVENANCE
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import decode_provenance
from pa_ros.wire.learning import decode_weights

PERIOD_S = 5.0  # a learner's weights are large: they are listened to now and then
LISTEN_S = 1.0


class AgentWeights:
    """Of the agent in a namespace: its checkpoint, which its provenance names, or a learner's."""

    def __init__(self, node: Node, namespace: str, refusals: Refusals) -> None:
        self._node, self._refusals = node, refusals
        self.insight: Insight | None = None
        self.why = ""  # why there is none
        self._topic = replace(POLICY_WEIGHTS, name=within(namespace, POLICY_WEIGHTS))
        self._shown = ("", -1)  # learner and version
        self._source, self._logic = "", PRODUCT
        self._reader: Any = None
        self._since = -PERIOD_S
        provenance = replace(PROVENANCE, name=within(namespace, PROVENANCE))
        guarded = refusals.guard(provenance.name, self._on_origin)
        self._origins = provenance.subscribe(node, guarded)

    def attend(self) -> None:
        """Called as long as somebody looks: listen for a moment, from time to time."""
        now = time.monotonic()
        if self._source == "topic" and self._reader is None and now - self._since > PERIOD_S:
            guarded = self._refusals.guard(self._topic.name, self._on_weights)
            self._reader, self._since = self._topic.subscribe(self._node, guarded), now
        elif self._reader is not None and now - self._since > LISTEN_S:
            self.rest()

    def rest(self) -> None:
        """Nobody looks."""
        if self._reader is not None:
            self._node.destroy_subscription(self._reader)
            self._reader = None

    def close(self) -> None:
        """Another arena is looked at."""
        self.rest()
        self._node.destroy_subscription(self._origins)

    def _on_origin(self, message: Message) -> None:
        parameters = decode_provenance(message).parameters
        if "checkpoint" not in parameters:
            return  # another node's
        self._source, path = str(parameters.get("weights")), str(parameters["checkpoint"])
        self._logic = logic_of(parameters)
        if self._source == "checkpoint":
            try:
                self.insight, self.why = Insight(load_policy(Path(path)), self._logic), ""
            except PaError as error:
                self.insight, self.why = None, str(error)
        elif self._source == "random":
            self.insight, self.why = None, "the agent's weights are random ones of its own"

    def _on_weights(self, message: Message) -> None:
        policy = decode_weights(message)
        snapshot, (learner, version) = policy.snapshot, self._shown
        if policy.learner_id != learner or snapshot.version > version:
            self.insight, self.why = Insight(snapshot, self._logic), ""
            self._shown = policy.learner_id, snapshot.version
