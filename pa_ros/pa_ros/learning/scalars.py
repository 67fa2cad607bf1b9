"""How learning goes, as scalars that TensorBoard shows (extra `tensorboard`)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pa_ros.core.errors import ConfigError
from pa_ros.learning.errors import LearningError

AXIS = "frames"


class Scalars:
    """Writes into a folder; frames are the horizontal axis, so that a resumed run goes on."""

    def __init__(self, folder: Path) -> None:
        """Raises ConfigError without the package, or where the folder can't be written."""
        writer = _writer()
        try:
            self._writer = writer(str(folder))
        except OSError as error:
            raise ConfigError(f"tensorboard: expected a folder to write to: {error}") from error
        self._frames = -1.0

    def add(self, metrics: Mapping[str, float]) -> None:
        """What a learner reports of itself, unless it made no frame since.

        LearningError, where there is no room for it; no more is to be added then.
        """
        if metrics[AXIS] == self._frames:
            return
        self._frames = metrics[AXIS]
        try:
            for name in metrics.keys() - {AXIS}:
                self._writer.add_scalar(f"learner/{name}", metrics[name], int(self._frames))
            self._writer.flush()
        except OSError as error:
            raise LearningError(
                f"tensorboard: expected room for more: {error}", code="learning.tensorboard"
            ) from error

    def close(self) -> None:
        """End its thread, too; what there is no room for is left out."""
        with suppress(OSError):
            self._writer.file_writer.close()


def _writer() -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise ConfigError(
            'tensorboard: expected the package: pip install "programmable-agents[tensorboard]" '
            f"(here, make install-tensorboard); got {error}"
        ) from error
    return SummaryWriter
