"""/diagnostics entries."""

from __future__ import annotations

from pa_ros.wire.codec.stamp import write_stamp
from pa_ros.wire.interfaces import DiagnosticArray, DiagnosticStatus, KeyValue
from pa_ros.wire.records import Health


def encode_diagnostics(entries: list[Health], stamp_ns: int) -> DiagnosticArray:
    """What a node has to say of itself, stamped with its clock."""
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
    """Entries of any node; nothing in them is trusted beyond being text."""
    return [
        Health(
            name=status.name,
            level=status.level[0],
            message=status.message,
            values={pair.key: pair.value for pair in status.values},
        )
        for status in message.status
    ]
