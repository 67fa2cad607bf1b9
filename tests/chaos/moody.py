"""An extension that lets things fail while files in the folder exist that the environment names: a
reward raises in sim_node (`raises`), and folders cannot be synced (`unsynced`)."""

import errno
import os
import stat
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pa_ros.world import REWARDS
from pa_ros.world.reward import Sparse

MOODS: Final = "PA_ROS_CHAOS_MOODS"  # environment variable
RAISES, UNSYNCED = "raises", "unsynced"
really_sync: Final = os.fsync


def in_mood(name: str) -> bool:
    return Path(os.environ[MOODS], name).exists()


@dataclass(frozen=True)
class Moody(Sparse):
    """As the paper's, in a good mood."""

    def __call__(self, satisfied: Any, measure: Any) -> Any:
        if "sim_node" in sys.argv[0] and in_mood(RAISES):
            raise ZeroDivisionError("it is in a bad mood")
        return super().__call__(satisfied, measure)


def sync(fd: Any) -> None:
    """As some network file systems do, which cannot sync a folder."""
    if in_mood(UNSYNCED) and stat.S_ISDIR(os.fstat(fd).st_mode):
        raise OSError(errno.EINVAL, "it is in a bad mood")
    really_sync(fd)


REWARDS.register("moody", Moody)
if MOODS in os.environ:
    os.fsync = sync
