"""An engine's updates without a learner to count them."""

from __future__ import annotations

from pa_ros.core.update import Batch, Engine
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.schedule import values_after


def update(engine: Engine, batch: Batch, config: LearnerConfig) -> None:
    """One update, after as many as the engine's Adam has made."""
    engine.update(batch, values_after(int(engine.tensors()["adam.actor.step"]), config))
