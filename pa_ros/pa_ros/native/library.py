"""Whether the fused engine is installed, and which networks it can compute."""

from __future__ import annotations

from types import ModuleType

from pa_ros.native.errors import FusedError
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import Canonical, Programmable, family_of, slot_values


def library() -> ModuleType:
    """The extension module; FusedError when it is not there or not loadable."""
    try:
        from pa_ros.native import _fused
    except ImportError as error:
        raise FusedError(f"fused engine: expected its library: {error}") from error
    return _fused


def level() -> str:
    """The instruction set in use: "x86-64-v4", "x86-64-v3" or "generic".

    FusedError when PA_ROS_FUSED_LEVEL asks for another, or one that this machine lacks.
    """
    name: str = library().level()
    return name


def why_not_network(network: NetworkConfig) -> str:
    """Why the fused code cannot compute a network; empty: it can.

    Raises FusedError as `level` does: a requested level is never ignored silently.
    """
    try:
        limit = library().MAX_SLOTS
    except FusedError as error:
        return str(error)
    level()
    kind = type(family_of(network))
    if kind not in (Programmable, Canonical):
        return f"it has no networks of the family {network.family}"
    if kind is Programmable:
        return ""
    if network.vocabulary.relation_inputs:
        return "it does not distinguish relations in canonical networks"
    slots = len(slot_values(network.world))
    return f"it takes {limit} slots, not {slots}" if slots > limit else ""
