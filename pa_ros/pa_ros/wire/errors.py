"""Refusals at the door: a message that is not what its definition in msgs_schema promises."""

from __future__ import annotations

from pa_ros.core.errors import PaError


class WireError(PaError):
    """A message refused: which field, what was expected, what came. Root of this room's errors."""

    code = "wire"

    def __init__(self, field: str, expected: object, received: object) -> None:
        super().__init__(f"{field}: expected {_short(expected)}, received {_short(received)}")


class SizeError(WireError):
    """An array or a count of another length than the message's other fields imply."""

    code = "wire.size"


class NonFiniteError(WireError):
    """NaN or infinity where the definition has none."""

    code = "wire.non_finite"


class RangeError(WireError):
    """A number or a constant outside what the definition allows."""

    code = "wire.range"


class JointNamesError(WireError):
    """A joint that this arm does not have, or one that is missing."""

    code = "wire.joint_names"


class StampError(WireError):
    """Parts of one control step that bear different stamps."""

    code = "wire.stamp"


class FeatureNamesError(WireError):
    """Object features in another layout, or of another width, than the world says."""

    code = "wire.feature_names"


class WorldError(WireError):
    """Another world than the receiver's: features, words or joints would not correspond."""

    code = "wire.world"


class RewardError(WireError):
    """Another reward than the one that is learned from."""

    code = "wire.reward"


class ArenaFactError(WireError):
    """Another control period, or other thresholds, than the arena's that is learned about."""

    code = "wire.arena_fact"


class DtypeError(WireError):
    """A tensor of another type than float32."""

    code = "wire.dtype"


class TruncatedError(WireError):
    """A payload that its tensors do not cover exactly."""

    code = "wire.truncated"


class ChecksumError(WireError):
    """A payload that is not what the sender summed."""

    code = "wire.checksum"


class VersionError(WireError):
    """Messages of another edition of msgs_schema."""

    code = "wire.version"


class UnknownTypeError(WireError):
    """A message type that no package installed here defines."""

    code = "wire.unknown_type"


class ProgramIdError(PaError):
    """A program under an id that stands for another one, or that is for the arena's own."""

    code = "program.id_taken"


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 200 else text[:197] + "..."
