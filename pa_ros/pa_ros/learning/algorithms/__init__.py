"""Algorithms by name; each with the same files: config, networks, learner, builder."""

from pa_ros.core.registry import Registry
from pa_ros.learning.algorithms.algorithm import Algorithm
from pa_ros.learning.algorithms.dpg.builder import DPG
from pa_ros.learning.algorithms.td3.builder import TD3

__all__ = ["ALGORITHMS", "Algorithm"]

ALGORITHMS: Registry[Algorithm] = Registry("algorithm")
for _algorithm in (DPG, TD3):
    ALGORITHMS.register(_algorithm.config.ALGORITHM, _algorithm)
