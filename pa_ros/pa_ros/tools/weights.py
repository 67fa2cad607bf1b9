"""The weights that a running agent acts with, for whoever wants to explain what it does."""

from __future__ import annotations

import posixpath
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.node import Node

from pa_ros.core.errors import PaError
from pa_ros.core.experience import PolicySnapshot
from pa_ros.language import Goal
from pa_ros.learning.checkpoints import load_policy
from pa_ros.networks.config import actor_config
from pa_ros.networks.families import check_goal
from pa_ros.ros.refusals import Refusals
from pa_ros.ros.topics import POLICY_WEIGHTS, PROVENANCE
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import decode_provenance
from pa_ros.wire.learning import decode_weights

if TYPE_CHECKING:
    from pa_ros.acting.insight import Insight

PERIOD_S = 5.0  # between two subscriptions to a learner's weights, which are large
LISTEN_S = 1.0  # how long such a subscription lasts


class AgentWeights:
    """The weights of the agent in a namespace, as far as they are known.

    They are those of the checkpoint that the agent's provenance names, or the newest of a learner.
    """

    def __init__(self, node: Node, namespace: str, refusals: Refusals) -> None:
        self._node, self._refusals = node, refusals
        self.why = ""  # why there is no insight
        self._insight: Insight | None = None
        self._unread: Path | PolicySnapshot | None = None  # weights newer than the insight's
        self._namespace, self._topic = f"/{namespace}", POLICY_WEIGHTS.within(f"/{namespace}")
        self.architecture = ""  # of the agent's networks; empty: not known
        self._newest = ("", -1)  # learner and version
        self._parameters: Mapping[str, Any] = {}  # of the agent
        self._reader: Any = None
        self._since = -PERIOD_S
        provenance = PROVENANCE.within(f"/{namespace}")
        guarded = refusals.guard(provenance.name, self._on_provenance)
        self._origins = provenance.subscribe(node, guarded)

    @property
    def insight(self) -> Insight | None:
        """Explains programs by the newest weights; None if none are known, `why` says why."""
        weights, self._unread = self._unread, None
        if weights is None:
            return self._insight
        # Imported late: torch takes seconds, and most users of a graph need no explanation.
        from pa_ros.acting.insight import Insight, agent_logic

        try:
            snapshot = load_policy(weights) if isinstance(weights, Path) else weights
            self._insight, self.why = Insight(snapshot, agent_logic(self._parameters)), ""
        except PaError as error:
            self._insight, self.why = None, str(error)
        return self._insight

    def check(self, goal: Goal) -> None:
        """Raise NetworkError or ProgramError if the agent's networks cannot represent a goal.

        Nothing is checked while they are not known.
        """
        if self.architecture:
            check_goal(actor_config(self.architecture), goal)

    @property
    def _of_learner(self) -> bool:
        return self._parameters.get("weights") == "topic"

    def forget(self) -> None:
        """Forget a learner's weights, so that the next ones are the newest."""
        if self._of_learner:
            self._insight, self._unread = None, None
            self._newest, self._since = ("", -1), -PERIOD_S

    def refresh(self) -> None:
        """Subscribe to a learner's weights for a moment, now and then; call it while a page is
        open."""
        now = time.monotonic()
        if self._of_learner and self._reader is None and now - self._since > PERIOD_S:
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
        self._parameters, self.architecture = parameters, ""
        # A fleet's learner is not in the namespace of an arena.
        learner = str(parameters.get("learner", ""))
        self._topic = POLICY_WEIGHTS.within(posixpath.join(self._namespace, learner))
        if parameters.get("weights") == "checkpoint":
            self._unread = Path(str(parameters["checkpoint"]))
            with suppress(PaError):  # of another machine: `insight` says why it is not known
                self.architecture = load_policy(self._unread).architecture
        elif parameters.get("weights") == "random":
            self._insight = self._unread = None
            self.why = "the agent drew random weights, which it doesn't publish"

    def _on_weights(self, message: Message) -> None:
        policy = decode_weights(message)
        snapshot, (learner, version) = policy.snapshot, self._newest
        if policy.learner_id != learner or snapshot.version > version:
            self._unread, self.architecture = snapshot, snapshot.architecture
            self._newest = policy.learner_id, snapshot.version
