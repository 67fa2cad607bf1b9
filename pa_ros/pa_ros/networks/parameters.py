"""Names, shapes and initial values of every network's tensors, in NumPy.

The one table that the torch reference, the fused engine and checkpoints share.
"""

from __future__ import annotations

import numpy as np

from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import Shapes, Tensors, family_of

__all__ = [
    "LITTLE", "NOTHING", "Tensors", "actor_shapes", "check_tensors", "critic_shapes",
    "initial_actor", "initial_critic", "not_finite",
]  # fmt: skip

LITTLE = 1e-6  # added to the sum of the pairs' weights before they are divided by it
NOTHING = 1e-30  # α's sum of relevances is taken to be at least this


def actor_shapes(config: NetworkConfig) -> Shapes:
    """Shape of each of the actor's tensors by state-dict name."""
    return family_of(config).shapes(config, critic=False)


def critic_shapes(config: NetworkConfig) -> Shapes:
    """Shape of each of the critic's tensors by state-dict name."""
    return family_of(config).shapes(config, critic=True)


def initial_actor(config: NetworkConfig, rng: np.random.Generator) -> Tensors:
    """Random initial weights of the actor; the same `rng` state gives the same weights."""
    return family_of(config).initial(config, False, rng)


def initial_critic(config: NetworkConfig, rng: np.random.Generator, start: float = 0.0) -> Tensors:
    """Random initial weights of the critic; the same `rng` state gives the same weights.

    Values start near `start`, the bias of the output (`NetworkSettings.critic_start`).
    """
    tensors = family_of(config).initial(config, True, rng)
    tensors["output.bias"][:] = start
    return tensors


def check_tensors(tensors: Tensors, shapes: Shapes, whose: str) -> None:
    """Raise NetworkError unless names, shapes, float dtype and finiteness are as they must be."""
    if tensors.keys() != shapes.keys():
        missing, extra = sorted(shapes.keys() - tensors), sorted(tensors.keys() - shapes)
        raise NetworkError(f"{whose}: tensors missing {missing[:8]}, not expected {extra[:8]}")
    for name, tensor in tensors.items():
        if tensor.shape != shapes[name]:
            raise NetworkError(f"{whose}: {name}: expected {shapes[name]}, got {tensor.shape}")
        if tensor.dtype not in (np.float32, np.float64):
            raise NetworkError(f"{whose}: {name}: expected a float tensor, got {tensor.dtype}")
    if wrong := not_finite(tensors):
        raise NetworkError(f"{whose}: {', '.join(wrong)}: expected finite numbers")


def not_finite(tensors: Tensors) -> list[str]:
    """Names of those with numbers that are not finite."""
    everything = np.concatenate([tensor.ravel() for tensor in tensors.values()])  # once is quicker
    if np.isfinite(everything).all():
        return []
    return [name for name, tensor in tensors.items() if not np.isfinite(tensor).all()]
