"""How agents act while they learn; a learner and its agents hold these in common."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from pa_ros.core.experience import NO_LAG
from pa_ros.core.settings import Settings


class ExplorationConfig(Settings):
    """Exploration noise: an Ornstein–Uhlenbeck process (paper, appendix); at times a random action
    instead, which is held for a while."""

    sigma: float = Field(0.3, ge=0, description="σ, a share of full speed (paper)")
    held: float = Field(
        0.0,
        ge=0,
        le=1,
        description="steps with a random action that is held, per step without: 0.3 is about a "
        "quarter of all steps",
    )
    acceleration: float = Field(
        0.0,
        ge=0,
        description="greatest change of the noise in a second, a share of full speed, so that a "
        "real arm is not shaken; 0: no limit",
    )
    damping: ClassVar[float] = 1.0  # θ, per second (paper)
    held_steps: ClassVar[int] = 8  # for which such an action is held on average


class Schedule(Settings):
    """Which weights may act when: the protocols of docs/DESIGN.md.

    A learner that has accepted v trajectories publishes version v. With one agent, what acts on
    which trajectory is then fixed, however fast either side is. Lag 0 makes acting and learning
    take turns; lag 1 lets the agent act on trajectory m while the learner works on m − 1.
    """

    in_step: Literal["arrival", "exact", "free"] = Field(
        "arrival",
        description="how several agents wait. arrival: trajectories are learned from as they "
        "arrive, and each agent waits for the weights of its own; exact: they are learned from in "
        "a fixed order, so that the same seed gives the same result; free: nobody waits",
    )
    trajectory_steps: int = Field(
        100, ge=1, le=10_000, description="transitions per trajectory: an episode"
    )
    policy_lag: int = Field(
        1,
        ge=0,
        le=10_000,
        description="trajectories that weights lag behind; 0 is the paper's interleaving",
    )
    oldest_policy: int = Field(
        100,
        ge=0,
        description="free: trajectories acted by weights more versions behind are not learned from",
    )

    @property
    def announced_lag(self) -> int:
        """`policy_lag` for agents, or NO_LAG if they do not wait."""
        return NO_LAG if self.in_step == "free" else self.policy_lag

    @property
    def versions_kept(self) -> int:
        """How many of the newest versions a learner can still be asked for."""
        return self.policy_lag + 1
