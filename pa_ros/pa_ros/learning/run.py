"""A learner as its agents see it, the same over the graph and in one process."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from uuid import uuid4

from pa_ros.core import __version__
from pa_ros.core.clock import now_ns
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey, LearnerInfo, PublishedPolicy, TrajectoryKey
from pa_ros.core.software import here
from pa_ros.learning.errors import DivergedError, LearningError
from pa_ros.learning.learner import Learner
from pa_ros.world import Trajectory

MADE_ON, AND_ON = "made_on", "; then "  # all machines that a run used, in order
AHEAD = 100  # trajectories, besides policy_lag, that an agent may be ahead of those accounted for
SILENT_S = 10.0  # without trajectories for so long, an agent may continue at any number

Facts = dict[str, float | int | str]


class LearningRun:
    """Announces what it asks of agents, and answers each trajectory with weights."""

    def __init__(
        self, learner: Learner, control_period_s: float, resumed: Mapping[str, Any] | None = None
    ) -> None:
        """`control_period_s`: of the arena. `resumed`: `facts` of the run that continues."""
        self.learner, resumed = learner, resumed or {}
        run_id = str(resumed.get("run_id", "")) or uuid4().hex
        self.info = _announcement(learner, control_period_s, run_id)
        machines = [name for name in str(resumed.get(MADE_ON, "")).split(AND_ON) if name]
        self._made_on = AND_ON.join(dict.fromkeys([*machines, here()]))
        self._schedule = learner.config.schedule
        self._latest: TrajectoryKey | None = None  # the one that led to the newest version
        self._received_at: dict[AgentKey, float] = {}  # when one arrived last

    def opening(self) -> list[PublishedPolicy]:
        """The versions that agents may still need, oldest first."""
        ids, now = (self.info.run_id, self.info.learner_id), now_ns()
        older = [PublishedPolicy(one, *ids, stamp_ns=now) for one in self.learner.published]
        return [*older[:-1], self.policy()]

    def facts(self, started_s: float, seed: int, **environment: str) -> Facts:
        """What a checkpoint holds beside the learner; `started_s`: on the steady clock.
        `environment`: as in TrainConfig."""
        return {
            **environment,
            "wall_s": time.monotonic() - started_s,
            "seed": seed,
            "run_id": self.info.run_id,
            MADE_ON: self._made_on,
        }

    def consume(self, trajectory: Trajectory) -> bool:
        """Learn from a trajectory. Returns whether it was new: a duplicate changes nothing.

        Raises LearningError or ProgramError for one that cannot be learned from. It is accounted
        for all the same, so that its agent does not wait for ever. Any weights may have acted: a
        recording's trajectories are welcome, too.
        """
        ledger = self.learner.replay.ledger
        if trajectory.run_id != self.info.run_id:  # what it made for another run is no loss here
            trajectory = replace(trajectory, first_of_run=trajectory.held_from)
        try:
            self._check_length(trajectory)
            self._check_age(trajectory)
            accepted = self.learner.consume(trajectory)
        # This is the learner's fault, not the trajectory's: it is not counted as rejected.
        except DivergedError:
            raise
        except PaError:
            if ledger.is_new(trajectory.key):
                ledger.record(trajectory.key, trajectory.held_from, trajectory.first_of_run)
                ledger.rejected += 1
            raise
        if accepted:
            self._latest = trajectory.key
        return accepted

    def check_sender(self, trajectory: Trajectory) -> None:
        """Raise LearningError for a trajectory that its agent cannot have sent; count it nowhere.

        An agent waits for weights that account for its trajectories, or keeps few of them, so it is
        never far ahead of what arrived lately. If a forged high number were accepted, the real
        agent's next trajectories would look like old ones. An agent may name any number only after
        it has sent nothing for SILENT_S: its learner restarted, or it was cut off.
        """
        agent, now = trajectory.agent, time.monotonic()
        first = self.learner.replay.ledger.accounted().get(agent, 0)
        if now - self._received_at.get(agent, -math.inf) > SILENT_S:
            first = max(first, trajectory.held_from)
        farthest = first + self._schedule.policy_lag + AHEAD
        if trajectory.sequence > farthest:
            raise LearningError(
                f"trajectory: expected at most number {farthest} of {trajectory.agent_id!r}, got "
                f"{trajectory.sequence}: does another node send under its name?",
                code="learning.ahead",
            )
        self._received_at[agent] = now

    def policy(self) -> PublishedPolicy:
        """The newest weights, and which trajectories they account for."""
        return PublishedPolicy(
            self.learner.snapshot(),
            self.info.run_id,
            self.info.learner_id,
            self.learner.replay.ledger.accounted(),
            self._latest,
            now_ns(),
        )

    def _check_age(self, trajectory: Trajectory) -> None:
        """Free agents act with whatever weights they have; leave out what too old ones did."""
        schedule, ledger = self._schedule, self.learner.replay.ledger
        age = self.learner.counters.version - trajectory.policy_version
        if schedule.in_step != "free" or age <= schedule.oldest_policy:
            return
        if trajectory.run_id == self.info.run_id and ledger.is_new(trajectory.key):
            raise LearningError(
                f"trajectory: expected one acted by weights of at most schedule.oldest_policy = "
                f"{schedule.oldest_policy} versions before {self.learner.counters.version}, got "
                f"number {trajectory.sequence} of {trajectory.agent_id!r}, acted by version "
                f"{trajectory.policy_version}",
                code="learning.too_old",
            )

    def _check_length(self, trajectory: Trajectory) -> None:
        longest = self.info.trajectory_steps
        if len(trajectory) > longest:
            raise LearningError(
                f"trajectory: expected at most trajectory_steps = {longest} transitions, "
                f"got {len(trajectory)} from {trajectory.agent_id!r}",
                code="learning.size",
            )


def _announcement(learner: Learner, control_period_s: float, run_id: str) -> LearnerInfo:
    network, config = learner.network, learner.config
    return LearnerInfo(
        run_id=run_id,
        learner_id=uuid4().hex,
        first_version=learner.counters.version,
        world_digest=network.world.digest,
        architecture=network.architecture,
        trajectory_steps=config.schedule.trajectory_steps,
        policy_lag=config.schedule.announced_lag,
        exploration=config.exploration.to_json(),
        inference=config.inference,
        control_period=control_period_s,
        thresholds=tuple(learner.scoring.thresholds.values()),
        reward=learner.scoring.reward.to_json(),
        algorithm=config.ALGORITHM,
        software_version=__version__,
        stamp_ns=now_ns(),
    )
