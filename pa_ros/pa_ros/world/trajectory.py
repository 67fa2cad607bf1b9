"""The experience that an agent sends and a learner learns from."""

from __future__ import annotations

from dataclasses import dataclass

from pa_ros.core.experience import AgentKey, Float32, Float64, TrajectoryKey
from pa_ros.language import Program


@dataclass(frozen=True, slots=True)
class Trajectory:
    """T consecutive transitions of one episode under one program, from one agent.

    Transition t goes from row t to row t + 1 of `objects` and `arm`.
    """

    agent_id: str
    sequence: int  # 0, 1, 2, … per incarnation; shows duplicates and gaps
    policy_version: int  # of the behaviour policy
    episode: int
    first_step: int
    program: Program  # over the world's words
    hand_index: int
    objects: Float32  # [T + 1, N, F]
    arm: Float32  # [T + 1, A]
    actions: Float32  # [T, J] in [-1, 1], as the arena executed them
    rewards: Float32  # [T], of row t + 1
    ends_episode: bool
    terminated: bool  # always False in reaching tasks, whose time limit is a truncation
    world_digest: str
    run_id: str = ""  # of the learner that trained the behaviour policy
    incarnation: int = 0  # of the agent
    held_from: int = 0  # the agent can still resend trajectories from this sequence number on
    first_of_run: int = 0  # sequence number of the agent's first for the run `run_id`
    stamp_ns: int = 0  # simulation time of row 0
    measures: Float64 | None = None
    """[T + 1, P], under each training program, as in `Verdict`; None: not said."""

    def __len__(self) -> int:
        return len(self.actions)

    @property
    def agent(self) -> AgentKey:
        """The agent that collected it."""
        return AgentKey(self.agent_id, self.incarnation)

    @property
    def key(self) -> TrajectoryKey:
        """Its unique name."""
        return TrajectoryKey(self.agent_id, self.incarnation, self.sequence)
