"""Φ of an actor's weights in NumPy, for one scene at a time: torch need not be loaded."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import Float32
from pa_ros.language import PRODUCT, Logic
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import Tensors

LAYERS = ("detectors.weight", "detectors.bias")


def sharpened(tensors: Tensors, logic: Logic) -> Tensors:
    """An actor's weights, its detectors as sharp as `logic` takes degrees."""
    if logic.sharpness == 1.0:
        return tensors
    factor = np.float32(logic.sharpness)
    return {name: x * factor if name in LAYERS else x for name, x in tensors.items()}


def degrees(
    network: NetworkConfig,
    tensors: Tensors,
    objects: Float32,
    arm: Float32,
    logic: Logic = PRODUCT,
) -> Float32:
    """Φ, [V, N], of one scene, objects [N, F] and arm [A], as sharp as `logic` says.

    See `networks.programmable.Trunk.phi`. Only for a family that evaluates programs.
    """
    if not family_of(network).detects(critic=False):
        return np.asarray(network.world.truth(objects).T)
    arms = np.tile(arm, (len(objects), 1))
    columns = np.hstack([objects * network.input_scales, arms])  # ω, [N, F + A]
    weight, bias = (tensors[name] for name in LAYERS)
    logits = np.float32(logic.sharpness) * (columns @ weight.T + bias)  # [N, V]
    ends = np.cumsum(network.vocabulary.group_sizes)[:-1]
    return np.vstack([_softmax(group) for group in np.split(logits, ends, axis=1)])


def _softmax(logits: Float32) -> Float32:
    """[G, N] of logits [N, G]."""
    weights = np.exp(logits - logits.max(axis=1, keepdims=True))
    return np.asarray((weights / weights.sum(axis=1, keepdims=True)).T)
