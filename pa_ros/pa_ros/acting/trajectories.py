"""From control steps to trajectories: the only place where transitions are made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pa_ros.acting.errors import ActingError
from pa_ros.core.experience import AgentKey, Float32, Observation, Verdict
from pa_ros.language import Program
from pa_ros.world import Trajectory
from pa_ros.world.world import World


@dataclass
class _Run:
    """Steps of one episode under one program and one policy version, not yet sent."""

    program: Program
    first: Observation
    last: Observation
    version: int = 0  # of the policy, once it has acted
    objects: list[Float32] = field(default_factory=list)
    arm: list[Float32] = field(default_factory=list)
    actions: list[Float32] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)

    def append(self, observation: Observation, arm: Float32) -> None:
        self.last = observation
        self.objects.append(observation.objects)
        self.arm.append(arm)


class TrajectoryBuilder:
    """Joins only consecutive steps of one episode under one program and one policy version.

    At each control step call `observe`, then `acted` with what was done about it. A step that
    does not continue the one before, in whatever way, begins a new run; what was collected until
    then is sent, as it is true.
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
        self._run: _Run | None = None
        self._acted = False

    @property
    def at_boundary(self) -> bool:
        """Whether no transition is pending, so that the next action begins a trajectory."""
        return self._run is None or not self._run.actions

    def observe(
        self, observation: Observation, verdict: Verdict, program: Program
    ) -> Trajectory | None:
        """Take in a step; return the trajectory that it completed, if it did.

        `program` is what the observation's program id stands for. Raises ActingError if the verdict
        is of another step than the observation.
        """
        _check_same_step(observation, verdict)
        run = self._run
        if run is None or not self._continues(run, observation, program):
            other_episode = run is not None and observation.episode != run.last.episode
            trajectory = self._finish(ends_episode=other_episode)
            self._begin(observation, program)
            return trajectory
        run.append(observation, self._world.arm(observation))
        run.rewards.append(verdict.reward)
        self._acted = False
        if verdict.truncated:
            return self._finish(ends_episode=True)
        if len(run.rewards) < self._trajectory_steps:
            return None
        trajectory = self._finish(ends_episode=False)
        self._begin(observation, program)
        return trajectory

    def acted(self, action: Float32, version: int) -> None:
        """Record the action, [J], applied at the step observed last, and the policy's version.

        Raises ActingError if no step was observed since the last action, or if the version is
        another one than that of the pending transitions: weights change between trajectories.
        """
        run = self._run
        if run is None or self._acted:
            raise ActingError(
                "action: expected an observation before it, got none", code="learning.step"
            )
        if run.actions and run.version != version:
            raise ActingError(
                f"action: expected policy version {run.version} until the trajectory ends, "
                f"got {version}",
                code="learning.step",
            )
        run.version = version
        run.actions.append(np.array(action, np.float32))
        self._acted = True

    def _continues(self, run: _Run, observation: Observation, program: Program) -> bool:
        last = run.last
        return (
            self._acted
            and program == run.program
            and observation.program_id == last.program_id
            and observation.episode == last.episode
            and observation.step == last.step + 1
            and observation.hand_index == last.hand_index
            and observation.objects.shape == last.objects.shape
        )

    def _begin(self, observation: Observation, program: Program) -> None:
        self._run = _Run(program, observation, observation)
        self._run.append(observation, self._world.arm(observation))
        self._acted = False

    def _finish(self, ends_episode: bool) -> Trajectory | None:
        """Close the run; None if no transition of it was completed."""
        run, self._run = self._run, None
        if run is None or not run.rewards:
            return None
        steps = len(run.rewards)  # an action whose outcome was never seen is left out
        self.sequence += 1
        return Trajectory(
            agent_id=self._agent.agent_id,
            incarnation=self._agent.incarnation,
            sequence=self.sequence - 1,
            run_id=self._run_id,
            policy_version=run.version,
            stamp_ns=run.first.stamp_ns,
            episode=run.last.episode,
            first_step=run.last.step - steps,
            program=run.program,
            hand_index=run.last.hand_index,
            objects=np.stack(run.objects[: steps + 1]),
            arm=np.stack(run.arm[: steps + 1]),
            actions=np.stack(run.actions[:steps]),
            rewards=np.array(run.rewards, np.float32),
            ends_episode=ends_episode,
            terminated=False,
            world_digest=self._world.digest,
        )


def _check_same_step(observation: Observation, verdict: Verdict) -> None:
    ours = (observation.episode, observation.step, observation.stamp_ns, observation.program_id)
    theirs = (verdict.episode, verdict.step, verdict.stamp_ns, verdict.program_id)
    if ours != theirs:
        raise ActingError(
            f"verdict: expected (episode, step, stamp, program) {ours}, got {theirs}",
            code="learning.step",
        )
