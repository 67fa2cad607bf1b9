"""An actor by the torch reference, where the fused code does not apply."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch

from pa_ros.core.experience import Float32
from pa_ros.language import PRODUCT, Logic, Program
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.detectors import sharpened
from pa_ros.networks.families import codes_of, family_of
from pa_ros.networks.parameters import Tensors
from pa_ros.networks.relevance import relevant_objects, relevant_sets


class TorchActor:
    """`Inference` by the modules of `pa_ros.networks`.

    Networks that evaluate no programs ignore `logic`.
    """

    def __init__(self, config: NetworkConfig, tensors: Tensors, logic: Logic = PRODUCT) -> None:
        self._config = config
        self._module = family_of(config).modules()[0](config).eval().requires_grad_(False)
        self._module.logic = logic
        self.load(tensors)

    def load(self, tensors: Tensors) -> None:
        sharp = sharpened(tensors, self._module.logic)
        self._module.load_state_dict({k: torch.from_numpy(v) for k, v in sharp.items()})

    @torch.inference_mode()
    def act(self, objects: Float32, arm: Float32, program: Program, hand_index: int) -> Float32:
        """See `Inference.act`."""
        programs = _programs(program, self._config)
        action = self._module(_scene(objects), _scene(arm), programs, hand_index)
        return np.asarray(action[0, 0].numpy())

    @torch.inference_mode()
    def degrees(self, objects: Float32, arm: Float32, program: Program, hand: int) -> Float32:
        """See `Inference.degrees`."""
        programs, logic = _programs(program, self._config), self._module.logic
        phi = self._module.phi(_scene(objects), _scene(arm))
        p = relevant_objects(phi, hand, programs, logic)[0]  # [1, N]
        registers = torch.stack([programs.moved, programs.target, programs.avoided], -1)
        sets = relevant_sets(phi, hand, programs, registers, logic)[0, 0]  # [3, N]
        return np.asarray(torch.cat([p, sets]).numpy())

    @torch.inference_mode()
    def properties(self, objects: Float32, arm: Float32) -> Float32:
        """Φ, [V, N], of networks that evaluate programs."""
        return np.asarray(self._module.phi(_scene(objects), _scene(arm))[0].numpy())


def _scene(array: Float32) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))[None]


@lru_cache(maxsize=1024)
def _programs(program: Program, network: NetworkConfig) -> Any:
    """One program for one scene, as the modules take it."""
    codes = codes_of(program, network)
    return family_of(network).programs(*(torch.from_numpy(code)[None] for code in codes))
