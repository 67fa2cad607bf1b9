"""Parameters of agent_node."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pa_ros.core.settings import OneOf
from pa_ros.language import LOGICS, MIN_MAX
from pa_ros.ros.environment import check_namespace
from pa_ros.ros.settings import NodeSettings

LONGEST_S = 1e6  # of any period; 11 days


class AgentConfig(NodeSettings):
    """One agent on the graph: greedy, or learning."""

    learning: bool = Field(
        False, description="explore, send transitions, and follow the synchronous protocol"
    )
    weights: Literal["topic", "checkpoint", "random"] = Field(
        "topic", description="where weights come from; learning needs topic"
    )
    checkpoint: str = Field("", description="folder of the checkpoint, if weights is checkpoint")
    learner: str = Field(
        "",
        description="namespace of the learner that sends weights and receives experience; "
        "empty: the agent's own",
    )
    agent_id: str = Field("", description="empty: a new one for each process")
    seed: int = Field(0, ge=0, description="of the exploration noise, and of random weights")
    logic: Annotated[str, OneOf(lambda: LOGICS)] = Field(
        MIN_MAX.name,
        description="how AND and OR combine degrees while programs are executed; a learning agent "
        "uses product",
    )
    resend_period_s: float = Field(
        2.0,
        gt=0,
        le=LONGEST_S,
        description="wall time after which trajectories are sent again if the learner has not "
        "accounted for them",
    )
    stuck_after_s: float = Field(
        10.0,
        gt=0,
        le=LONGEST_S,
        description="wall time; waiting longer than this for weights is an ERROR",
    )
    controller: Literal["none", "velocity", "joint_trajectory", "joint_jog"] = Field(
        "none", description="how commands are also sent to ros2_control"
    )
    max_acceleration: float = Field(
        0.0, ge=0, le=1e3, description="rad/s², of commands to controllers; 0: no limit"
    )

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        check_namespace(self.learner.rstrip("/"), "learner")
        if self.learning and self.weights != "topic":
            raise ValueError(f"weights: expected 'topic' for learning, got {self.weights!r}")
        if (self.weights == "checkpoint") != bool(self.checkpoint):
            raise ValueError(
                "checkpoint: expected a folder if and only if weights is 'checkpoint', "
                f"got {self.checkpoint!r} and {self.weights!r}"
            )
        return self
