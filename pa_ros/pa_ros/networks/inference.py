"""One actor, one observation: what is computed, by fused code or by torch."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from pa_ros.core.experience import Float32
from pa_ros.language import Program
from pa_ros.networks.parameters import Tensors

RELEVANT, MOVED, TARGET, AVOIDED = range(4)
"""Rows of `Acted.degrees`: p, then the sets of what is moved, where to, and what to avoid."""
SETS = 4


class Acted(NamedTuple):
    """An action, and how far the program means each object of the scene."""

    action: Float32  # [J] in [-1, 1]
    degrees: Float32  # [4, N]; [0, N] of networks that evaluate no programs


class Inference(Protocol):
    """Actions of one set of weights at a time."""

    def load(self, tensors: Tensors) -> None:
        """Act with these weights, which fit the network, from now on."""

    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Acted:
        """Act on objects [N, F] and arm [A]; NetworkError or ProgramError for a program that the
        network cannot represent."""
