"""Parameters of learner_node."""

from __future__ import annotations

from pydantic import Field, model_validator
from typing_extensions import Self

from pa_ros.core.authentication import Authenticated
from pa_ros.core.extensions import Extensible
from pa_ros.learning.protocols import LearningChoice, Protocol, protocol_named


class LearnerNodeConfig(LearningChoice, Authenticated, Extensible):
    """One learner on the graph; what it learns about comes with arena_info."""

    seed: int = Field(0, ge=0, description="of initial weights and of sampling")
    options: tuple[str, ...] = Field(
        (), description="learner.PART.NAME=VALUE or network.NAME=VALUE over the protocol"
    )
    arenas: tuple[str, ...] = Field(
        (), description="namespaces of the arenas that are learned about; empty: the learner's own"
    )
    out: str = Field("", description="folder of the checkpoint; empty: none is written")
    resume: bool = Field(False, description="go on from the checkpoint in out")
    checkpoint_every_frames: int = Field(50_000, ge=0, description="0: only when the node stops")

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if self.resume and not self.out:
            raise ValueError("out: expected the folder to resume from, got ''")
        self.settings()
        return self

    def settings(self) -> Protocol:
        """How to learn; ConfigError for an unknown protocol or option."""
        return protocol_named(self.protocol, self.algorithm).with_options(self.options)
