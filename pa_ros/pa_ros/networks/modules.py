"""The torch modules of each family of networks, and the form in which they take programs."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from pa_ros.networks.canonical import CanonicalActor, CanonicalCritic
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import Canonical, family_of
from pa_ros.networks.programmable import ProgrammableActor, ProgrammableCritic, Programs


def modules_of(network: NetworkConfig) -> tuple[type[Any], type[Any]]:
    """Classes of actor and critic. Both are made from a network's configuration."""
    if isinstance(family_of(network), Canonical):
        return CanonicalActor, CanonicalCritic
    return ProgrammableActor, ProgrammableCritic


def goals_of(network: NetworkConfig, *codes: Tensor) -> Any:
    """What the modules take as programs, for `Family.codes` gathered as tensors [B, K, …]."""
    if isinstance(family_of(network), Canonical):
        return codes[0]
    op, a, b, *more = codes
    roles = more.pop() if network.vocabulary.moves_objects else None
    return Programs(op, a, b, more[0] if more else None, roles)
