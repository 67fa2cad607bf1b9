"""Stable-Baselines3's DDPG as a contender: the same frames and batch, canonical 400-400 MLPs."""

from __future__ import annotations

from typing import Any

from pa_ros.benchmarks.learner import SB3
from pa_ros.benchmarks.rounds import Contender

HIDDEN = [400, 400]  # paper, appendix "Training parameters"
BATCH = 64
STEPS = 1000  # of random actions, to fill the replay buffer


def sb3_contender(environment: Any) -> Contender:
    """`train()` of its DDPG on a Gymnasium environment with a flat observation, one thread.

    Raises ImportError if Stable-Baselines3 is not installed.
    """
    import torch
    from stable_baselines3 import DDPG

    model = DDPG(
        "MlpPolicy",
        environment,
        batch_size=BATCH,
        learning_starts=STEPS + 1,
        policy_kwargs={"net_arch": HIDDEN},
        device="cpu",
        seed=0,
    )
    model.learn(STEPS)
    torch.set_num_threads(1)
    return Contender(SB3, lambda calls: model.train(gradient_steps=calls, batch_size=BATCH))
