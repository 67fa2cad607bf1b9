"""Algorithms by name. Each has the same files: config, learner, builder."""

from pa_ros.learning.algorithms.algorithm import Algorithm, Algorithms
from pa_ros.learning.algorithms.dpg.builder import DPG
from pa_ros.learning.algorithms.td3.builder import TD3

__all__ = ["ALGORITHMS", "Algorithm"]

ALGORITHMS = Algorithms("algorithm")
for _algorithm in (DPG, TD3):
    ALGORITHMS.register(_algorithm.config.ALGORITHM, _algorithm)
