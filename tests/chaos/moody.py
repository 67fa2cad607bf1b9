"""A reward that raises in sim_node while the file exists that the environment names."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pa_ros.world import REWARDS
from pa_ros.world.reward import Sparse

RAISES: Final = "PA_ROS_CHAOS_RAISES"  # environment variable


@dataclass(frozen=True)
class Moody(Sparse):
    """As the paper's, in a good mood."""

    def __call__(self, satisfied: Any, measure: Any) -> Any:
        if "sim_node" in sys.argv[0] and Path(os.environ[RAISES]).exists():
            raise ZeroDivisionError("it is in a bad mood")
        return super().__call__(satisfied, measure)


REWARDS.register("moody", Moody)
