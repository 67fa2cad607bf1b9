"""Settings of DPG, beside those that all algorithms share."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from pa_ros.learning.config import LearnerConfig


class DPGConfig(LearnerConfig):
    """Deterministic policy gradient (paper, appendix "Training parameters").

    Not settings: hard target copies after each episode, and one update of both networks at once.
    """

    ALGORITHM: ClassVar[str] = "dpg"

    gradient_clip: float = Field(1.0, gt=0, description="bound of each element of ∂Q/∂a (paper)")
    action_penalty: float = Field(
        0.0,
        ge=0,
        description="this times the action is subtracted from ∂Q/∂a: the hand rests at its goal",
    )
