"""What made the messages of a recording (Provenance)."""

from __future__ import annotations

import json
from typing import Any

from pa_ros.core.settings import read_json
from pa_ros.wire import errors
from pa_ros.wire.codec.program import read_programs
from pa_ros.wire.codec.stamp import read_stamp, write_stamp
from pa_ros.wire.codec.world import read_world, write_world
from pa_ros.wire.interfaces import Provenance
from pa_ros.wire.records import WIRE_VERSION, LearnerOrigin, Origin
from pa_ros.world.world import World


def encode_provenance(origin: Origin) -> Provenance:
    """One process's account of itself."""
    message = Provenance()
    write_stamp(message.stamp, origin.stamp_ns)
    message.node = origin.node
    message.instance = origin.instance
    message.software_version = origin.software_version
    message.wire_version = WIRE_VERSION
    message.versions = origin.versions
    message.seed = origin.seed
    message.parameters = json.dumps(dict(origin.parameters), sort_keys=True)
    message.design = origin.design
    message.arm = origin.arm
    message.preset = origin.preset
    if origin.world is not None:
        write_world(message, origin.world)
    if origin.learner is not None:
        message.first_version = origin.learner.first_version
        message.network = origin.learner.network
        message.learner = origin.learner.learner
        message.algorithm = origin.learner.algorithm
        message.training_programs = list(map(str, origin.learner.training_programs))
    return message


def decode_provenance(message: Provenance) -> Origin:
    """Raises VersionError (another edition of the messages), RangeError (parameters), ConfigError
    and WorldError (the world)."""
    if message.wire_version != WIRE_VERSION:
        raise errors.VersionError("provenance.wire_version", WIRE_VERSION, message.wire_version)
    world = read_world("provenance", message) if message.world else None
    return Origin(
        node=message.node,
        instance=message.instance,
        software_version=message.software_version,
        versions=message.versions,
        seed=int(message.seed),
        parameters=_parameters(message.parameters),
        design=message.design,
        arm=message.arm,
        preset=message.preset,
        world=world,
        stamp_ns=read_stamp(message.stamp),
        learner=_learner(message, world),
    )


def _learner(message: Provenance, world: World | None) -> LearnerOrigin | None:
    if not message.learner:
        return None
    if world is None:
        raise errors.RangeError("provenance.world", "the world that was learned about", "''")
    return LearnerOrigin(
        first_version=int(message.first_version),
        network=message.network,
        learner=message.learner,
        algorithm=message.algorithm,
        training_programs=read_programs(message, world),
    )


def _parameters(text: str) -> dict[str, Any]:
    try:
        values = read_json(text)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise errors.RangeError("provenance.parameters", "a JSON object", repr(text))
    return values
