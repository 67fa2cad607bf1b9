"""Worlds, as the messages that announce one carry them."""

from __future__ import annotations

from pa_ros.wire import errors
from pa_ros.wire.interfaces import ArenaInfo, Provenance
from pa_ros.world.world import World


def write_world(message: ArenaInfo | Provenance, world: World) -> None:
    """The world as JSON, and its digest."""
    message.world, message.world_digest = world.to_json(), world.digest


def read_world(where: str, message: ArenaInfo | Provenance) -> World:
    """Raises ConfigError for what is no world, WorldError if it is not the digest's."""
    world = World.from_json(message.world)
    if world.digest != message.world_digest:
        raise errors.WorldError(f"{where}.world_digest", world.digest, message.world_digest)
    return world
