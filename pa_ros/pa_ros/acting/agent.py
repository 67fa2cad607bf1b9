"""An agent that learns: it explores, and sends trajectories, under the synchronous protocol."""

from __future__ import annotations

from typing import Protocol

from pa_ros.acting.actor import Actor
from pa_ros.acting.errors import PolicyError, StepError
from pa_ros.acting.trajectories import TrajectoryBuilder
from pa_ros.core.experience import Float32, Observation, PolicySnapshot, Trajectory, Verdict


class Schedule(Protocol):
    """Which weights may act when; `pa_ros.acting.config.Schedule` is one."""

    def acting_version(self, trajectory: int) -> int:
        """Version that acts on trajectory 0, 1, 2, … of an agent."""


class LearningAgent:
    """At each control step: `observe`, send the trajectory it returns, `load` if required, `act`.

    The order matters and is the same over the graph and in process: a trajectory that ends at an
    observation is sent before the action at that observation is chosen.
    """

    def __init__(self, actor: Actor, builder: TrajectoryBuilder, schedule: Schedule) -> None:
        self.actor = actor
        self.builder = builder
        self._schedule = schedule
        self._latest: tuple[Observation, str] | None = None

    @property
    def required_version(self) -> int | None:
        """Version that must be loaded before `act`; None while a trajectory is under way."""
        if not self.builder.at_boundary:
            return None
        version = self._schedule.acting_version(self.builder.sequence)
        return None if version == self.actor.version else version

    def load(self, snapshot: PolicySnapshot) -> None:
        """Act with these weights from here on; PolicyError if a trajectory is under way."""
        if not self.builder.at_boundary:
            raise PolicyError(f"policy {snapshot.version}: expected the end of a trajectory first")
        self.actor.load(snapshot)

    def observe(
        self, observation: Observation, verdict: Verdict, program: str
    ) -> Trajectory | None:
        """Take in one step; return the trajectory that it completed, if it did."""
        self._latest = None if verdict.truncated else (observation, program)
        return self.builder.observe(observation, verdict, program)

    def act(self) -> Float32:
        """The exploring action, [6] in [-1, 1], at the step observed last.

        Raises StepError after the last step of an episode, PolicyError if other weights than the
        ones in use are required.
        """
        if self._latest is None:
            raise StepError("action: expected a step that goes on, got none")
        if self.required_version is not None:
            raise PolicyError(
                f"policy: expected version {self.required_version}, got {self.actor.version}"
            )
        action = self.actor.explore(*self._latest)
        self.builder.acted(action, self.actor.version)
        self._latest = None
        return action
