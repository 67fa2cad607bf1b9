"""DPG's own settings, beside those that algorithms share."""

from __future__ import annotations

from pydantic import Field

from pa_ros.core.settings import Settings
from pa_ros.learning.config import LearnerConfig


class AscentConfig(Settings):
    """The actor's objective: Q less the price of the action."""

    gradient_clip: float = Field(1.0, gt=0, description="of each element of ∂Q/∂a (paper)")
    action_l2: float = Field(
        0.0, ge=0, description="of ½|a|², taken from Q; keeps the actor's tanh alive"
    )
    action_l2_decay: float = Field(
        0.0, ge=0, le=1, description="share of action_l2 that is lost, evenly"
    )
    action_l2_decay_updates: int = Field(20_000, ge=1, description="updates until it is lost")


class DPGConfig(LearnerConfig):
    """Deterministic policy gradient (paper, appendix "Training parameters").

    Not settings: hard target copies after each episode, and one update of both networks at once.
    """

    actor: AscentConfig = AscentConfig()
