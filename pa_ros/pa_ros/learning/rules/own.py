"""The program that acted and its reward, as in the paper."""

from __future__ import annotations

import numpy as np

from pa_ros.learning.replay_buffer.buffer import ReplayBuffer
from pa_ros.learning.rules.rule import Drawn, Rule


class OwnProgram(Rule):
    """Transitions are learned under the program that acted (paper, appendix)."""

    def draw(self, rng: np.random.Generator, replay: ReplayBuffer, size: int) -> Drawn:
        index = replay.sample(rng, size)
        program, reward = replay.arrays["program"][index], replay.arrays["reward"][index]
        discount = self.discounts(replay, index)
        return Drawn(replay, index, program[:, None], reward[:, None], discount)
