"""One actor, one observation: what is computed, by fused code or by torch."""

from __future__ import annotations

from typing import Protocol

from pa_ros.core.experience import Float32
from pa_ros.language import Program
from pa_ros.networks.parameters import Tensors

RELEVANT, MOVED, TARGET, AVOIDED = range(4)
"""Rows of degrees: p, then the sets of what is moved, where to, and what to avoid."""


class Inference(Protocol):
    """Actions of one set of weights at a time, for objects [N, F] and arm [A], both C-contiguous.

    NetworkError or ProgramError for a program that the network cannot represent.
    """

    def load(self, tensors: Tensors) -> None:
        """Act with these weights, which fit the network, from now on."""

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """The action in [-1, 1], [J]."""

    def degrees(self, objects: Float32, arm: Float32, program: Program, hand: int) -> Float32:
        """How far the program means each object, [4, N]; only where networks evaluate programs."""
