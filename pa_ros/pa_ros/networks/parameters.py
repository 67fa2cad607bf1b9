"""Names, shapes and initial values of every network's tensors, in NumPy.

The one table that the torch reference, the fused update, the NumPy actor and checkpoints share.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import PaError
from pa_ros.core.experience import ARM_FEATURES, COLORS, JOINTS, OBJECT_FEATURES, SHAPES, Float32
from pa_ros.language.vocabulary import Vocabulary
from pa_ros.networks.config import NetworkConfig
from pa_ros.world.properties import PROPERTIES

COLUMN_FEATURES = OBJECT_FEATURES + ARM_FEATURES  # 34, one column ω of Ω (paper, appendix)
GEOMETRY = np.delete(np.arange(COLUMN_FEATURES), PROPERTIES)  # the rest of ω
RELATIONS = ("query", "context", "local.0", "message.0")  # layers that f, r and α read ω with
NOTHING = 1e-30  # α's sum of relevances is taken to be at least this
LILLICRAP_OUTPUT_SCALE = 3e-3  # Lillicrap et al. 2015, section 7

Tensors = dict[str, Float32]
Shapes = dict[str, tuple[int, ...]]


class TensorError(PaError):
    """Tensors that do not fit the network: says which name, expected and received."""

    code = "networks.tensors"


def actor_shapes(config: NetworkConfig) -> Shapes:
    """Shape of each of the actor's tensors by state-dict name."""
    if config.kind == "canonical":
        return _canonical_shapes(config, critic=False)
    shapes = _trunk_shapes(config, detectors=config.kind != "true-properties")
    return shapes | _linear("output", JOINTS, config.hidden)


def critic_shapes(config: NetworkConfig) -> Shapes:
    """Shape of each of the critic's tensors by state-dict name."""
    if config.kind == "canonical":
        return _canonical_shapes(config, critic=True)
    shapes = _trunk_shapes(config, detectors=config.kind == "programmable")
    shapes |= _linear("action", config.hidden, JOINTS)
    return shapes | _linear("output", 1, config.hidden)


def initial_actor(config: NetworkConfig, rng: np.random.Generator) -> Tensors:
    """Random initial weights of the actor; the same `rng` state gives the same weights."""
    last = LILLICRAP_OUTPUT_SCALE if config.kind == "canonical" else config.actor_output_scale
    return _initial(config, actor_shapes(config), rng, output_scale=last)


def initial_critic(config: NetworkConfig, rng: np.random.Generator) -> Tensors:
    """Random initial weights of the critic; the same `rng` state gives the same weights."""
    last = LILLICRAP_OUTPUT_SCALE if config.kind == "canonical" else None
    tensors = _initial(config, critic_shapes(config), rng, output_scale=last)
    tensors["output.bias"][:] = config.critic_output_bias
    return tensors


def check_tensors(tensors: Tensors, shapes: Shapes, whose: str) -> None:
    """Raise TensorError unless names, shapes, float dtype and finiteness are as they must be."""
    check_shapes(tensors, shapes, whose)
    for name, tensor in tensors.items():
        if tensor.dtype not in (np.float32, np.float64):
            raise TensorError(f"{whose}: {name}: expected a float tensor, got {tensor.dtype}")
        if not np.isfinite(tensor).all():
            raise TensorError(f"{whose}: {name}: expected finite numbers")


def check_shapes(tensors: Mapping[str, NDArray[np.generic]], shapes: Shapes, whose: str) -> None:
    """Raise TensorError unless `tensors` has exactly these names and shapes."""
    if tensors.keys() != shapes.keys():
        missing, extra = sorted(shapes.keys() - tensors), sorted(tensors.keys() - shapes)
        raise TensorError(f"{whose}: tensors missing {missing[:8]}, not expected {extra[:8]}")
    for name, shape in shapes.items():
        if tensors[name].shape != shape:
            raise TensorError(f"{whose}: {name}: expected {shape}, got {tensors[name].shape}")


def slot_words(vocabulary: Vocabulary) -> list[tuple[str, str]]:
    """(shape, color) of each block slot of the canonical networks' flattened Ω, in order."""
    shapes = [word for word in vocabulary.shapes if word in SHAPES]
    colors = [word for word in vocabulary.colors if word in COLORS]
    return [(shape, color) for shape in shapes for color in colors]


def canonical_inputs(vocabulary: Vocabulary) -> int:
    """Size of the canonical networks' input: hand, block slots, arm, target one-hots."""
    slots = 1 + len(slot_words(vocabulary))
    return slots * OBJECT_FEATURES + ARM_FEATURES + len(vocabulary.words)


def _linear(name: str, outputs: int, inputs: int) -> Shapes:
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}


def _trunk_shapes(config: NetworkConfig, detectors: bool) -> Shapes:
    hidden, attention = config.hidden, config.attention
    shapes: Shapes = {}
    if detectors:
        shapes |= _linear("detectors", len(config.vocabulary.words), COLUMN_FEATURES)
    shapes |= _linear("query", attention, COLUMN_FEATURES)
    shapes |= _linear("context", attention, COLUMN_FEATURES)
    shapes |= {"attention.weight": (attention,)}
    shapes |= _linear("local.0", hidden, COLUMN_FEATURES) | _linear("local.1", hidden, hidden)
    shapes |= _linear("message.0", hidden, 2 * COLUMN_FEATURES)
    return shapes | _linear("message.1", hidden, hidden)


def _canonical_shapes(config: NetworkConfig, critic: bool) -> Shapes:
    hidden = config.canonical_hidden
    actions = JOINTS if critic else 0  # the action enters at the second hidden layer
    shapes = _linear("layers.0", hidden, canonical_inputs(config.vocabulary))
    shapes |= _linear("layers.1", hidden, hidden + actions)
    return shapes | _linear("output", 1 if critic else JOINTS, hidden)


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
        if hidden and name.endswith(".weight"):
            tensors[name].reshape(shape[0], -1, COLUMN_FEATURES)[..., PROPERTIES] = 0.0
    return tensors
