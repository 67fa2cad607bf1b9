"""Parameters of learner_node."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from pa_ros.core.settings import OneOf
from pa_ros.learning.recipes import RECIPES, LearningSettings
from pa_ros.ros.environment import check_namespace
from pa_ros.ros.settings import NodeSettings


class LearnerNodeConfig(NodeSettings, LearningSettings):
    """One learner on the graph; what it learns about comes with arena_info."""

    recipe: Annotated[str, OneOf(lambda: RECIPES, or_empty=True)] = Field(
        "",
        description="named set of defaults for `learner` and `network`; empty: the one that the "
        "arena's programs need",
    )
    seed: int = Field(0, ge=0, description="of initial weights and of sampling")
    arenas: tuple[str, ...] = Field(
        (), description="namespaces of the arenas to learn about; empty: the learner's own"
    )
    agents: tuple[str, ...] = Field(
        (),
        description="agent_id of each that learns; with learner.schedule.in_step=exact the order "
        "in which their trajectories are learned from",
    )
    out: str = Field("", description="folder of the checkpoint; empty: none is written")
    resume: bool = Field(False, description="continue from the checkpoint in out")
    tensorboard: str = Field(
        "", description="folder of scalars for TensorBoard, every 5 s; empty: none are written"
    )
    checkpoint_every_frames: int = Field(50_000, ge=0, description="0: only when the node stops")

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        for arena in self.arenas:
            check_namespace(arena.rstrip("/"), "arenas")
        if self.resume and not self.out:
            raise ValueError("out: expected the folder to resume from, got ''")
        if self._exact and len(self.arenas) > 1 and not self.agents:
            raise ValueError(
                f"agents: expected the agent_id of each that learns in the {len(self.arenas)} "
                "arenas, in the order that learner.schedule.in_step=exact keeps, got none"
            )
        if len(set(self.agents)) != len(self.agents):
            raise ValueError(f"agents: expected each once, got {list(self.agents)}")
        return self

    @property
    def turns(self) -> tuple[str, ...]:
        """Agents in the order of their turns; empty: learn in the order of arrival."""
        return self.agents if self._exact else ()

    @property
    def _exact(self) -> bool:
        return self.learner.schedule.in_step == "exact"
