"""Settings of TD3, beside those that all algorithms share."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from pa_ros.core.settings import Settings
from pa_ros.learning.config import LearnerConfig

CRITICS = ("critic_1", "critic_2")  # names of its two critics


class SmoothingConfig(Settings):
    """Noise on the target's action, so that neighbouring actions have similar values."""

    sigma: float = Field(0.2, ge=0, description="deviation, a share of full speed")
    clip: float = Field(0.5, ge=0, description="largest noise, likewise")


class TargetsConfig(Settings):
    """How the targets follow."""

    tau: float = Field(
        0.005, gt=0, le=1, description="share of the difference by which they move at each step"
    )


class TD3Config(LearnerConfig):
    """Twin delayed DPG (Fujimoto et al. 2018); defaults are that paper's.

    Not a setting: the target is of the lesser of two critics.
    """

    ALGORITHM: ClassVar[str] = "td3"

    smoothing: SmoothingConfig = SmoothingConfig()
    targets: TargetsConfig = TargetsConfig()
    delay: int = Field(2, ge=1, description="updates of the critics for one of actor and targets")
