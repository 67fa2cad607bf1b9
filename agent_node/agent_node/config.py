"""Parameters of agent_node."""

from __future__ import annotations

from dataclasses import dataclass

from pa_ros.core.errors import ConfigError
from pa_ros.networks.config import KINDS

WEIGHTS = ("topic", "checkpoint", "random")


@dataclass(frozen=True)
class AgentConfig:
    """One agent on the graph: greedy, or learning."""

    learning: bool = False  # explore, send transitions, and follow the synchronous protocol
    weights: str = "topic"  # where weights come from; learning needs "topic"
    checkpoint: str = ""  # folder, for weights "checkpoint"
    agent_id: str = ""  # empty: a new one at each start
    seed: int = 0  # of the exploration noise, and of random weights
    network: str = "programmable"  # of random weights
    resend_period_s: float = 2.0  # trajectories not yet taken up are sent again
    stuck_after_s: float = 10.0  # waiting longer than this for weights is an alarm

    def __post_init__(self) -> None:
        for name, allowed in (("weights", WEIGHTS), ("network", KINDS)):
            if getattr(self, name) not in allowed:
                raise ConfigError(f"{name}: expected one of {allowed}, got {getattr(self, name)!r}")
        if self.learning and self.weights != "topic":
            raise ConfigError(f"weights: expected 'topic' for learning, got {self.weights!r}")
        if (self.weights == "checkpoint") != bool(self.checkpoint):
            raise ConfigError(
                "checkpoint: expected a folder if and only if weights is 'checkpoint', "
                f"got {self.checkpoint!r} and {self.weights!r}"
            )
        if self.seed < 0:
            raise ConfigError(f"seed: expected at least 0, got {self.seed}")
        for name in ("resend_period_s", "stuck_after_s"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ConfigError(f"{name}: expected a positive time, got {getattr(self, name)}")
