"""A process's report about itself: health (/diagnostics) and origin (Provenance)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from msgs_schema import msg
from pa_ros.core.settings import read_json
from pa_ros.language import Program
from pa_ros.wire import WireError
from pa_ros.wire.arena import (
    WIRE_VERSION,
    check_version,
    read_programs,
    read_world,
    write_world,
)
from pa_ros.wire.fields import SharedFields, read_stamp, write_stamp
from pa_ros.world.world import World


@dataclass(frozen=True, slots=True)
class Health:
    """One entry of /diagnostics. Levels are those of DiagnosticStatus: 0 ok, 1 warn, 2 error."""

    name: str
    level: int = 0
    message: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LearnerOrigin:
    """The part of an Origin that only a learner has."""

    first_version: int  # of the weights it began with; 0: from scratch
    network: str  # NetworkConfig's JSON
    learner: str  # the learner settings' JSON
    algorithm: str  # that these settings belong to
    training_programs: tuple[Program, ...]  # in the order of relabeling


@dataclass(frozen=True)
class Origin:
    """Configuration, seed and versions of one process; Provenance.msg explains the fields."""

    node: str
    instance: str
    software_version: str
    versions: str
    seed: int
    parameters: Mapping[str, Any]  # plain JSON
    design: str = ""
    arm: str = ""
    preset: str = ""
    world: World | None = None  # None: not known to the sender
    stamp_ns: int = 0  # wall time
    learner: LearnerOrigin | None = None  # None: not a learner


SAME = SharedFields(Origin, msg.Provenance)
SAME_OF_LEARNER = SharedFields(LearnerOrigin, msg.Provenance)


def encode_diagnostics(entries: list[Health], stamp_ns: int) -> DiagnosticArray:
    """A node's entries, stamped with its clock."""
    message = DiagnosticArray()
    write_stamp(message.header.stamp, stamp_ns)
    message.status = [
        DiagnosticStatus(
            level=bytes([entry.level]),
            name=entry.name,
            message=entry.message,
            hardware_id="",
            values=[KeyValue(key=key, value=value) for key, value in entry.values.items()],
        )
        for entry in entries
    ]
    return message


def decode_diagnostics(message: DiagnosticArray) -> list[Health]:
    """The entries of any node. All texts pass."""
    return [
        Health(
            name=status.name,
            level=status.level[0],
            message=status.message,
            values={pair.key: pair.value for pair in status.values},
        )
        for status in message.status
    ]


def encode_provenance(origin: Origin) -> msg.Provenance:
    """The origin of one process's messages."""
    message = msg.Provenance()
    write_stamp(message.stamp, origin.stamp_ns)
    SAME.write(message, origin)
    message.wire_version = WIRE_VERSION
    message.parameters = json.dumps(dict(origin.parameters), sort_keys=True)
    if origin.world is not None:
        write_world(message, origin.world)
    if origin.learner is not None:
        SAME_OF_LEARNER.write(message, origin.learner)
        message.training_programs = list(map(str, origin.learner.training_programs))
    return message


def decode_provenance(message: msg.Provenance) -> Origin:
    """The origin of one process's messages. Raises WireError, ConfigError (no world)."""
    check_version("provenance", message)
    world = read_world("provenance", message) if message.world else None
    return Origin(
        parameters=_parameters(message.parameters),
        world=world,
        stamp_ns=read_stamp(message.stamp),
        learner=_learner(message, world),
        **SAME.read(message),
    )


def _learner(message: msg.Provenance, world: World | None) -> LearnerOrigin | None:
    if not message.learner:
        return None
    if world is None:
        raise WireError("provenance.world", "the learner's world", "''", code="wire.range")
    return LearnerOrigin(
        training_programs=read_programs(message, world), **SAME_OF_LEARNER.read(message)
    )


def _parameters(text: str) -> dict[str, Any]:
    try:
        values = read_json(text)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        expected = "a JSON object"
        raise WireError("provenance.parameters", expected, repr(text), code="wire.range")
    return values
