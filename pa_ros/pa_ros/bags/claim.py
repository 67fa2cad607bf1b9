"""Who writes a bag holds a lock on its folder, so that a recording that goes on is told from one
that was killed. Recorders of others hold none."""

from __future__ import annotations

import os
from pathlib import Path

from pa_ros.bags.errors import BagInUseError
from pa_ros.core.lock import take_lock


class Claim:
    """A bag's folder, taken until it is released or the process ends; a context manager."""

    def __init__(self, folder: Path) -> None:
        """Raises BagInUseError if another has it, OSError if it can't be opened."""
        self._descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        if not take_lock(self._descriptor):
            self.release()
            raise BagInUseError(
                f"bag: {folder}: it is still being recorded, or repaired: expected its recorder "
                "to have ended"
            )

    def release(self) -> None:
        """Does nothing the second time."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1

    def __enter__(self) -> Claim:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()
