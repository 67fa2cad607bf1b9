"""What a state means: which objects a program names, whether it is satisfied, what that earns."""

from pa_ros.world.reward import Reward, Sparse
from pa_ros.world.scoring import Score, Scoring
from pa_ros.world.trajectory import Trajectory

__all__ = ["Reward", "Score", "Scoring", "Sparse", "Trajectory"]
