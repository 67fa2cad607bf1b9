"""The meaning of a state: its objects, the ones that a program names, and the reward."""

from pa_ros.world.reward import REWARDS, Reward, Sparse, reward_from
from pa_ros.world.scoring import Score, Scoring
from pa_ros.world.trajectory import Trajectory

__all__ = ["REWARDS", "Reward", "Score", "Scoring", "Sparse", "Trajectory", "reward_from"]
