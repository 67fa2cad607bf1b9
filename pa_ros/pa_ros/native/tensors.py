"""A network's tensors inside the flat buffers of the fused engine."""

from __future__ import annotations

import numpy as np

from pa_ros.core.experience import Float32
from pa_ros.native import _fused
from pa_ros.networks.parameters import Tensors


class FlatTensors:
    """Named tensors in a flat buffer of the library's: `read` and `write` by state-dict names."""

    def __init__(self, network: _fused.Network, buffer: Float32) -> None:
        """`buffer`: of `network`, in the library's layout."""
        self.network = network
        self._layout = _fused.layout_of(network)
        self._parts = self._views(buffer)

    def read(self) -> Tensors:
        """Copies, C-contiguous."""
        return {
            name: np.ascontiguousarray(np.concatenate(views, axis=-1))
            if len(views) > 1
            else views[0].copy()
            for name, views in self._parts.items()
        }

    def write(self, tensors: Tensors) -> None:
        """Overwrite them; names and shapes have been checked."""
        for name, views in self._parts.items():
            start = 0
            for view in views:
                view[:] = tensors[name][..., start : start + view.shape[-1]]
                start += view.shape[-1]

    def _views(self, buffer: Float32) -> dict[str, list[Float32]]:
        """For each tensor, views that make it up side by side along the last axis."""
        n, at = self.network, self._layout
        views: dict[str, list[Float32]] = {}
        if n.is_canonical:
            return self._canonical_layers(buffer) | self._head(buffer)
        if n.detectors:
            views |= self._first(buffer, "detectors", at.detectors, n.words)
        views |= self._first(buffer, "query", at.query, n.attention)
        views |= self._first(buffer, "context", at.context, n.attention)
        views["attention.weight"] = [buffer[at.attention_weight :][: n.attention]]
        views |= self._first(buffer, "local.0", at.local, n.hidden)
        views |= self._second(buffer, "local.1", 0)
        views |= self._first(buffer, "message.0", at.receiver, n.hidden)
        views["message.0.weight"] += self._first(buffer, "", at.sender, n.hidden)[".weight"]
        views |= self._second(buffer, "message.1", 1)
        if n.relations:
            added = _rows(buffer, at.relation, at)[: n.relations, : n.hidden]
            views["relation.weight"] = [added.T]
        if n.avoids:
            views |= self._first(buffer, "avoid.0", at.avoid, n.hidden)
            views["avoid.1.weight"] = self._second(buffer, "", 2)[".weight"]
        for layer in range(n.upper_layers):
            rows = _rows(buffer, at.upper + layer * (at.hidden + 1) * at.hidden, at)
            views[f"upper.{layer}.weight"] = [rows[: n.hidden, : n.hidden].T]
            views[f"upper.{layer}.bias"] = [rows[at.hidden, : n.hidden]]
        return views | self._head(buffer)

    def _first(
        self, buffer: Float32, name: str, column: int, size: int
    ) -> dict[str, list[Float32]]:
        at = self._layout
        matrix = buffer[at.first :][: at.rows * at.columns].reshape(at.rows, at.columns)
        columns = matrix[:, column : column + size]
        return {
            f"{name}.weight": [columns[:-1].T],
            f"{name}.bias": [columns[-1]],
        }

    def _second(self, buffer: Float32, name: str, index: int) -> dict[str, list[Float32]]:
        at, size = self._layout, self.network.hidden
        weight = _rows(buffer, at.second + index * at.hidden**2, at)[:size, :size]
        bias = _rows(buffer, at.second_bias, at)[index % 2, :size]  # avoid.1 has none
        return {f"{name}.weight": [weight.T], f"{name}.bias": [bias]}

    def _canonical_layers(self, buffer: Float32) -> dict[str, list[Float32]]:
        at, size, critic = self._layout, self.network.hidden, self.network.critic
        inputs = at.inputs + self.network.words
        first = _rows(buffer, at.first, at)[: inputs + 1, :size]
        weights = [_rows(buffer, at.second, at)[:size, :size].T]
        bias = _rows(buffer, at.second_bias, at)[0, :size]
        if critic:  # the action enters beside the hidden units, and brings the layer's bias
            action = _rows(buffer, at.action, at)[: self.network.actions + 1, :size]
            weights, bias = [*weights, action[:-1].T], action[-1]
        return {
            "layers.0.weight": [first[:inputs].T],
            "layers.0.bias": [first[inputs]],
            "layers.1.weight": weights,
            "layers.1.bias": [bias],
        }

    def _head(self, buffer: Float32) -> dict[str, list[Float32]]:
        at, size, critic = self._layout, self.network.hidden, self.network.critic
        outputs = 1 if critic else self.network.actions
        views: dict[str, list[Float32]] = {}
        if critic and not self.network.is_canonical:
            rows = _rows(buffer, at.action, at)[: self.network.actions + 1, :size]
            views |= {"action.weight": [rows[:-1].T], "action.bias": [rows[-1]]}
        views["output.weight"] = [_rows(buffer, at.output, at)[:outputs, :size]]
        views["output.bias"] = [buffer[at.output_bias :][:outputs]]
        return views


def _rows(buffer: Float32, offset: int, at: _fused.Layout) -> Float32:
    """Rows of `hidden` floats from an offset to where no whole one is left."""
    count = (len(buffer) - offset) // at.hidden
    return buffer[offset : offset + count * at.hidden].reshape(count, at.hidden)
