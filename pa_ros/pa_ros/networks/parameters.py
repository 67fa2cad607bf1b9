"""Names, shapes and initial values of every network's tensors, in NumPy.

The one table that the torch reference, the fused engine and checkpoints share.
"""

from __future__ import annotations

import math

import numpy as np

from pa_ros.core.experience import Float32
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.errors import NetworkError
from pa_ros.networks.families import Shapes, family_of

DETECTORS_BIAS = "detectors.bias"
RELATIONS = ("query", "context", "local.0", "message.0")  # layers that f, r and α read ω with
NOTHING = 1e-30  # α's sum of relevances is taken to be at least this

Tensors = dict[str, Float32]


def actor_shapes(config: NetworkConfig) -> Shapes:
    """Shape of each of the actor's tensors by state-dict name."""
    return family_of(config).shapes(config, critic=False)


def critic_shapes(config: NetworkConfig) -> Shapes:
    """Shape of each of the critic's tensors by state-dict name."""
    return family_of(config).shapes(config, critic=True)


def initial_actor(config: NetworkConfig, rng: np.random.Generator) -> Tensors:
    """Random initial weights of the actor; the same `rng` state gives the same weights."""
    last = family_of(config).output_scale(config, critic=False)
    return _initial(config, actor_shapes(config), rng, output_scale=last)


def initial_critic(config: NetworkConfig, rng: np.random.Generator) -> Tensors:
    """Random initial weights of the critic; the same `rng` state gives the same weights."""
    last = family_of(config).output_scale(config, critic=True)
    tensors = _initial(config, critic_shapes(config), rng, output_scale=last)
    tensors["output.bias"][:] = config.critic_output_bias
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


def _initial(
    config: NetworkConfig, shapes: Shapes, rng: np.random.Generator, output_scale: float | None
) -> Tensors:
    tensors: Tensors = {}
    for name, shape in shapes.items():
        layer = name.rpartition(".")[0]
        bound = 1.0 / math.sqrt(shapes[f"{layer}.weight"][-1])
        if layer == "output" and output_scale is not None:
            bound = output_scale
        if layer == "detectors":
            bound *= config.detector_init_scale
        tensors[name] = rng.uniform(-bound, bound, shape).astype(np.float32)
        hidden = layer in RELATIONS and not config.relations_see_properties
        if name == DETECTORS_BIAS and not config.detectors_have_biases:
            tensors[name][:] = 0.0
        if hidden and name.endswith(".weight"):
            columns = tensors[name].reshape(shape[0], -1, config.world.columns)
            columns[..., config.world.schema.properties] = 0.0
    return tensors
