"""A learner as its agents know it, over the graph as in process."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any
from uuid import uuid4

from pa_ros import __version__
from pa_ros.core.errors import PaError
from pa_ros.core.experience import TrajectoryKey
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.core.software import here
from pa_ros.learning.errors import DivergedError, LearningError
from pa_ros.learning.learner import Learner
from pa_ros.world import Trajectory

AHEAD = 100  # trajectories that an agent may be ahead of its account, beside policy_lag
MADE_ON, AND_ON = "made_on", "; then "  # `here` of all machines that a run was on, in order

Facts = dict[str, float | int | str]


class LearningRun:
    """Announces what is asked of agents, and answers each trajectory with weights."""

    def __init__(
        self, learner: Learner, control_period_s: float, before: Mapping[str, Any] | None = None
    ) -> None:
        """`control_period_s`: of the arena. `before`: `facts` of the run that goes on."""
        self.learner, before = learner, before or {}
        run_id = str(before.get("run_id", "")) or uuid4().hex
        self.info = _announcement(learner, control_period_s, run_id)
        places = [place for place in str(before.get(MADE_ON, "")).split(AND_ON) if place]
        self._made_on = AND_ON.join(dict.fromkeys([*places, here()]))
        self._schedule = learner.config.schedule
        self._latest: TrajectoryKey | None = None  # that led to the newest version

    def opening(self) -> list[PublishedPolicy]:
        """The versions that may still be asked for, oldest first."""
        older = list(self.learner.published)[:-1]
        ids = self.info.run_id, self.info.learner_id
        return [*(PublishedPolicy(one, *ids, stamp_ns=time.time_ns()) for one in older),
                self.policy()]  # fmt: skip

    def facts(self, started_s: float, seed: int, design: str, preset: str, arm: str) -> Facts:
        """What a checkpoint says beside the learner; `started_s`: of the steady clock."""
        wall_s, run_id = time.monotonic() - started_s, self.info.run_id
        return {"wall_s": wall_s, "seed": seed, "design": design, "preset": preset, "arm": arm,
                "run_id": run_id, MADE_ON: self._made_on}  # fmt: skip

    def consume(self, trajectory: Trajectory) -> None:
        """Learn from a trajectory; a duplicate changes nothing.

        Raises LearningError or ProgramError for one that cannot be learned from. It is then
        accounted for all the same, since no agent must wait for ever; but not with
        LearningError or LearningError. Whose weights acted doesn't matter: it may be a
        recording's.
        """
        ledger = self.learner.replay.ledger
        self.check(trajectory)
        try:
            self._check_length(trajectory)
            self._check_age(trajectory)
            if self.learner.consume(trajectory).insert.accepted:
                self._latest = trajectory.key
        except DivergedError:
            raise
        except PaError:
            if ledger.is_new(trajectory.key):
                ledger.record(trajectory.key, trajectory.held_from, taken=False)
            raise

    def check(self, trajectory: Trajectory) -> None:
        """Raise LearningError or LearningError for a trajectory that is not to be heard."""
        self.learner.replay.ledger.check(trajectory)
        self._check_ahead(trajectory)

    def policy(self) -> PublishedPolicy:
        """The newest weights, and what is accounted for by now."""
        return PublishedPolicy(
            self.learner.snapshot(),
            self.info.run_id,
            self.info.learner_id,
            self.learner.replay.ledger.accounted(),
            self._latest,
            time.time_ns(),
        )

    def _check_ahead(self, trajectory: Trajectory) -> None:
        """An agent waits for weights that account for all but `policy_lag` of its trajectories."""
        accounted = self.learner.replay.ledger.accounted().get(trajectory.agent, 0)
        first = max(accounted, trajectory.held_from)
        farthest = first + self._schedule.policy_lag + AHEAD
        if trajectory.sequence > farthest:
            raise LearningError(
                f"trajectory: expected at most number {farthest} of {trajectory.agent_id!r}, of "
                f"whose trajectories those before {first} are accounted for, got "
                f"{trajectory.sequence}: does someone else send under its name?",
                code="learning.ahead",
            )

    def _check_age(self, trajectory: Trajectory) -> None:
        """Free agents act with whatever weights they have: what too old ones did is left out."""
        schedule, replay = self._schedule, self.learner.replay
        age = self.learner.counters.version - trajectory.policy_version
        if schedule.in_step != "free" or age <= schedule.oldest_policy:
            return
        if trajectory.run_id == self.info.run_id and replay.ledger.is_new(trajectory.key):
            replay.ledger.too_old += 1
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
    network, acting = learner.network, learner.config.acting
    return LearnerInfo(
        run_id=run_id,
        learner_id=uuid4().hex,
        first_version=learner.counters.version,
        world_digest=network.world.digest,
        architecture=network.architecture,
        trajectory_steps=acting.schedule.trajectory_steps,
        policy_lag=acting.schedule.announced_lag,
        exploration=acting.exploration.to_json(),
        inference=acting.inference,
        control_period=control_period_s,
        thresholds=tuple(learner.scoring.thresholds.values()),
        reward=learner.scoring.reward.to_json(),
        algorithm=learner.config.ALGORITHM,
        software_version=__version__,
        stamp_ns=time.time_ns(),
    )
