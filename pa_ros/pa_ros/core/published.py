"""What a learner publishes for its agents, whatever the transport."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pa_ros.core.experience import AgentKey, PolicySnapshot, TrajectoryKey

NO_LAG = 2**32 - 1  # as policy_lag: agents act with the newest weights they have, and never wait


@dataclass(frozen=True, slots=True)
class LearnerInfo:
    """What a learner asks of its agents, and all that they need to know of it."""

    run_id: str  # kept when a run resumes
    learner_id: str  # new at every start
    first_version: int  # newest version of the weights at this start; 0: from scratch
    world_digest: str
    architecture: str  # canonical JSON of the actor's configuration
    trajectory_steps: int  # transitions after which a trajectory is sent at the latest
    policy_lag: int  # trajectories; NO_LAG: agents don't wait
    exploration: str  # canonical JSON of the exploration noise
    inference: str  # what computes actions: "auto" or "torch"
    control_period: float  # s, of the arena learned about
    thresholds: tuple[float, ...]  # of the relations of the arena learned about
    reward: str  # canonical JSON: name and parameters, of the arena learned about
    algorithm: str = "dpg"  # by which it learns, for people: agents act as the rest says
    software_version: str = ""
    stamp_ns: int = 0  # wall time; of one run, the learner that came last is followed

    @property
    def free(self) -> bool:
        """Whether agents act with the newest weights they have, and never wait."""
        return self.policy_lag == NO_LAG


@dataclass(frozen=True)
class PublishedPolicy:
    """A snapshot with what the synchronous protocol needs to know of it."""

    snapshot: PolicySnapshot
    run_id: str
    learner_id: str = ""
    accounted: Mapping[AgentKey, int] = field(default_factory=dict)  # all before this sequence are
    latest: TrajectoryKey | None = None  # led to this version; None: not known
    stamp_ns: int = 0  # wall time

    @property
    def name(self) -> tuple[str, str, int]:
        """Run, learner and version: the same weights have the same."""
        return self.run_id, self.learner_id, self.snapshot.version
