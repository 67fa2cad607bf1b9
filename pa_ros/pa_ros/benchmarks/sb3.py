"""The DDPG of Stable-Baselines3, and of SBX in JAX, as contenders: the same frames and batch,
canonical 400-400 MLPs."""

from __future__ import annotations

import os
from typing import Any

from pa_ros.benchmarks.learner import SB3, SBX
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

    made = _contender(SB3, DDPG, environment, device="cpu")
    torch.set_num_threads(1)
    return made


def sbx_contender(environment: Any) -> Contender:
    """The same of SBX, whose updates are compiled. Raises ImportError if SBX is not installed."""
    one = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ.setdefault("XLA_FLAGS", one)  # before jax is loaded
    from sbx import DDPG

    made = _contender(SBX, DDPG, environment)
    made.run(1)  # compiles it
    return made


def _contender(name: str, kind: Any, environment: Any, **options: Any) -> Contender:
    model = kind(
        "MlpPolicy",
        environment,
        batch_size=BATCH,
        learning_starts=STEPS + 1,
        policy_kwargs={"net_arch": HIDDEN},
        seed=0,
        **options,
    )
    model.learn(STEPS)
    return Contender(name, lambda calls: model.train(gradient_steps=calls, batch_size=BATCH))
