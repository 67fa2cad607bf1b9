"""One actor, one observation, NumPy alone: what an agent runs at every control step."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pa_ros.core.experience import OBJECT_FEATURES, Float32
from pa_ros.language import Program, compile_program
from pa_ros.language.flat import AND, COPY, NOT, FlatProgram
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.parameters import (
    COLUMN_FEATURES,
    NOTHING,
    Tensors,
    actor_shapes,
    check_tensors,
)
from pa_ros.networks.slots import slot_matrices, target_one_hots
from pa_ros.world.properties import truth_matrix


class Inference(Protocol):
    """Actions of one set of weights."""

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """Action in [-1, 1], [6], for objects [N, 16] and arm [18]."""


def make_inference(config: NetworkConfig, tensors: Tensors) -> Inference:
    """The actor of `config` with these weights; TensorError if they do not fit."""
    check_tensors(tensors, actor_shapes(config), "actor")
    if config.kind == "canonical":
        return CanonicalInference(config, tensors)
    return ProgrammableInference(config, tensors)


class ProgrammableInference:
    """`ProgrammableActor` for one observation; equal to it to float precision.

    All first layers are one matrix, split into what multiplies an object's 16 features (position
    scale folded in) and what multiplies the arm's 18, which all objects share.
    """

    def __init__(self, config: NetworkConfig, tensors: Tensors) -> None:
        self._vocabulary = config.vocabulary
        self._self_weight = config.self_weight
        receiver, sender = np.hsplit(tensors["message.0.weight"], [COLUMN_FEATURES])
        weights = [tensors[f"{name}.weight"] for name in ("local.0", "query", "context")]
        biases = [tensors[f"{name}.bias"] for name in ("local.0", "query", "context", "message.0")]
        weights += [receiver, sender]
        biases += [np.zeros(len(sender), np.float32)]
        self._truth = truth_matrix(config.vocabulary)
        self._learned = "detectors.weight" in tensors
        if self._learned:
            weights.append(tensors["detectors.weight"])
            biases.append(tensors["detectors.bias"])
        first = np.concatenate(weights).T.astype(np.float32)  # [34, all]
        first[:3] *= config.position_scale
        self._object_weight = np.ascontiguousarray(first[:OBJECT_FEATURES])
        self._arm_weight = np.ascontiguousarray(first[OBJECT_FEATURES:])
        self._bias = np.concatenate(biases)
        ends = np.cumsum([len(weight) for weight in weights])
        self._spans = [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
        self._attention = tensors["attention.weight"]
        last = [tensors["local.1.weight"], tensors["message.1.weight"]]
        self._last = np.concatenate(last, 1).T.copy()  # [2H, H]
        self._last_bias = tensors["local.1.bias"] + tensors["message.1.bias"]
        self._output = tensors["output.weight"].T.copy()
        self._output_bias = tensors["output.bias"]

    def properties(self, objects: Float32, arm: Float32) -> Float32:
        """Φ, [V, N]."""
        return self._properties(objects, self._first_layers(objects, arm))

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """Action in [-1, 1], [6], for objects [N, 16] and arm [18]."""
        first = self._first_layers(objects, arm)
        local, query, context, receiver, sender = (first[:, span] for span in self._spans[:5])
        phi = self._properties(objects, first)
        p = _relevant(phi, compile_program(program, self._vocabulary), hand_index)  # [N]
        scores = np.tanh(query[:, None] + context) @ self._attention  # [N, N]
        alpha = p * np.exp(scores - scores.max(1, keepdims=True))
        alpha.ravel()[:: len(alpha) + 1] *= self._self_weight
        weights = (p / np.maximum(alpha.sum(1), NOTHING))[:, None] * alpha  # p_i α_ij
        messages = np.tanh(receiver[:, None] + sender)  # [N, N, H]
        f, r = p @ np.tanh(local), weights.ravel() @ messages.reshape(weights.size, -1)
        h = np.concatenate([f, r]) @ self._last + p.sum() * self._last_bias
        action: Float32 = np.tanh(np.tanh(h) @ self._output + self._output_bias)
        return action

    def _first_layers(self, objects: Float32, arm: Float32) -> Float32:
        layers: Float32 = objects @ self._object_weight + (arm @ self._arm_weight + self._bias)
        return layers

    def _properties(self, objects: Float32, first: Float32) -> Float32:
        if not self._learned:
            true: Float32 = (objects @ self._truth).T
            return true
        logits = first[:, self._spans[5]].T  # [V, N]
        phi: Float32 = np.exp(logits - logits.max(0))
        shapes = self._vocabulary.group_sizes[0]
        for group in (phi[:shapes], phi[shapes:]):
            group /= group.sum(0)
        return phi


class CanonicalInference:
    """`CanonicalActor` for one observation; equal to it to float precision."""

    def __init__(self, config: NetworkConfig, tensors: Tensors) -> None:
        self._vocabulary = config.vocabulary
        self._shapes, self._colors = slot_matrices(config.vocabulary)
        self._scale = np.ones(OBJECT_FEATURES, np.float32)
        self._scale[:3] = config.position_scale
        self._layers = [
            (tensors[f"{name}.weight"], tensors[f"{name}.bias"])
            for name in ("layers.0", "layers.1", "output")
        ]

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """Action in [-1, 1], [6]; UnsupportedProgramError for what the network cannot be told."""
        target = target_one_hots(program, self._vocabulary)
        fills = (objects @ self._shapes) * (objects @ self._colors)  # [N, S]
        scaled = objects * self._scale
        x: Float32 = np.concatenate([scaled[hand_index], (fills.T @ scaled).ravel(), arm, target])
        for weight, bias in self._layers:
            x = np.tanh(weight @ x + bias)
        return x


def _relevant(phi: Float32, flat: FlatProgram, hand_index: int) -> Float32:
    """p, [N], by running the flat program over the rows of Φ (paper, eq. logic)."""
    hand = np.zeros(phi.shape[1], np.float32)
    hand[hand_index] = 1.0
    registers: list[Float32] = [*phi, hand]
    for op, a, b in zip(flat.op, flat.a, flat.b, strict=True):
        x, y = registers[a], registers[b]
        if op == NOT:
            registers.append(1 - x)
        elif op == AND:
            registers.append(x * y)
        else:
            registers.append(x if op == COPY else x + y - x * y)
    return registers[-1]
