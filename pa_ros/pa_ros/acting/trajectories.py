"""Join control steps to trajectories: the only place where transitions are made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pa_ros.core.experience import AgentKey, Float32, Observation, Verdict
from pa_ros.language import Program
from pa_ros.world import Trajectory
from pa_ros.world.world import World


@dataclass
class _Pending:
    """Steps of one episode under one program and one policy version, not yet sent."""

    program: Program
    first: Observation
    last: Observation
    version: int = 0  # of the policy, once it has acted
    objects: list[Float32] = field(default_factory=list)
    arm: list[Float32] = field(default_factory=list)
    actions: list[Float32] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    measures: list[tuple[float, ...] | None] = field(default_factory=list)

    def append(self, observation: Observation, arm: Float32, verdict: Verdict) -> None:
        self.last = observation
        self.measures.append(verdict.measures)
        # Objects found since the first step have rows of their own in the next trajectory.
        self.objects.append(observation.objects[: len(self.first.objects)])
        self.arm.append(arm)


class TrajectoryBuilder:
    """Joins only consecutive steps of one episode under one program and one policy version.

    At each control step call `observe`, then `acted` with the action taken. A step that does not
    continue the one before begins a new trajectory; the transitions collected before it are true
    and are sent.
    """

    def __init__(
        self,
        agent: AgentKey,
        run_id: str,
        trajectory_steps: int,
        world: World,
        first_sequence: int = 0,
    ) -> None:
        self.sequence = first_sequence  # of the next trajectory
        self._agent, self._run_id = agent, run_id
        self._trajectory_steps = trajectory_steps
        self._world = world
        self._pending: _Pending | None = None
        self._acted = False

    @property
    def at_boundary(self) -> bool:
        """Whether no transition is pending, so that the next action begins a trajectory."""
        return self._pending is None or not self._pending.actions

    def observe(
        self, observation: Observation, verdict: Verdict, program: Program
    ) -> Trajectory | None:
        """Take in a step. Returns the trajectory that it completed, if any.

        `verdict` is of that observation, `program` the one that its program id names.
        """
        pending = self._pending
        if pending is None or not self._continues(pending, observation, program):
            other_episode = pending is not None and observation.episode != pending.last.episode
            trajectory = self._finish(ends_episode=other_episode)
            self._begin(observation, verdict, program)
            return trajectory
        found_more = len(observation.objects) > len(pending.first.objects)
        pending.append(observation, self._world.arm(observation), verdict)
        pending.rewards.append(verdict.reward)
        self._acted = False
        if verdict.truncated:
            return self._finish(ends_episode=True)
        if not found_more and len(pending.rewards) < self._trajectory_steps:
            return None
        trajectory = self._finish(ends_episode=False)
        self._begin(observation, verdict, program)
        return trajectory

    def acted(self, action: Float32, version: int) -> None:
        """Record the action, [J], applied at the step observed last, and the policy's version.

        The agent changes weights between trajectories only, so the version is that of all pending
        transitions.
        """
        pending = self._pending
        assert pending is not None, "a step was observed"
        pending.version = version
        pending.actions.append(np.array(action, np.float32))
        self._acted = True

    def applied(self, action: Float32 | None) -> None:
        """Replace the action recorded last by what the arm did; None: that is not known, and the
        trajectory ends at the step observed last."""
        pending = self._pending
        assert pending is not None and pending.actions, "an action was recorded"
        if action is None:
            self._acted = False
        else:
            pending.actions[-1] = np.array(action, np.float32)

    def _continues(self, pending: _Pending, observation: Observation, program: Program) -> bool:
        last = pending.last
        return (
            self._acted
            and program == pending.program
            and observation.program_id == last.program_id
            and observation.episode == last.episode
            and observation.step == last.step + 1
            and observation.hand_index == last.hand_index
            and len(observation.objects) >= len(last.objects)
        )

    def _begin(self, observation: Observation, verdict: Verdict, program: Program) -> None:
        self._pending = _Pending(program, observation, observation)
        self._pending.append(observation, self._world.arm(observation), verdict)
        self._acted = False

    def _finish(self, ends_episode: bool) -> Trajectory | None:
        """The pending transitions as a trajectory; None if none was completed."""
        pending, self._pending = self._pending, None
        if pending is None or not pending.rewards:
            return None
        steps = len(pending.rewards)  # an action whose outcome was never seen is left out
        measures = [row for row in pending.measures[: steps + 1] if row is not None]
        self.sequence += 1
        return Trajectory(
            agent_id=self._agent.agent_id,
            incarnation=self._agent.incarnation,
            sequence=self.sequence - 1,
            run_id=self._run_id,
            policy_version=pending.version,
            stamp_ns=pending.first.stamp_ns,
            episode=pending.last.episode,
            first_step=pending.last.step - steps,
            program=pending.program,
            hand_index=pending.last.hand_index,
            objects=np.stack(pending.objects[: steps + 1]),
            arm=np.stack(pending.arm[: steps + 1]),
            actions=np.stack(pending.actions[:steps]),
            rewards=np.array(pending.rewards, np.float32),
            ends_episode=ends_episode,
            terminated=False,
            world_digest=self._world.digest,
            measures=np.array(measures, np.float64) if len(measures) == steps + 1 else None,
        )
