"""Messages to the core's dataclasses and back: no other module touches a message field.

Every `decode_*` checks sizes, finiteness and ranges before it returns, raises a WireError that says
what was expected and what came, and returns arrays that own their memory.
"""

from __future__ import annotations

from pa_ros.wire.codec.arena import decode_arena_info, encode_arena_info
from pa_ros.wire.codec.experience import decode_trajectory, decode_trajectory_key, encode_trajectory
from pa_ros.wire.codec.health import decode_diagnostics, encode_diagnostics
from pa_ros.wire.codec.learner import decode_learner_info, encode_learner_info
from pa_ros.wire.codec.program import (
    decode_program,
    decode_program_status,
    encode_program,
    encode_program_status,
)
from pa_ros.wire.codec.provenance import decode_provenance, encode_provenance
from pa_ros.wire.codec.services import (
    decode_outcome,
    decode_pause,
    decode_reset,
    decode_speed,
    decode_steps,
    encode_outcome,
    encode_pause,
    encode_reset,
    encode_speed,
    encode_steps,
)
from pa_ros.wire.codec.stamp import decode_clock, encode_clock, header_stamp
from pa_ros.wire.codec.step import (
    StepMessages,
    arena_of,
    decode_command,
    decode_context,
    decode_executed,
    decode_hand_pose,
    decode_joints,
    decode_objects,
    decode_observation,
    decode_step_mark,
    decode_verdict,
    encode_command,
    encode_observation,
    encode_verdict,
    is_evaluation,
)
from pa_ros.wire.codec.weights import decode_weights, encode_weights, weights_checksum

__all__ = [
    "StepMessages",
    "arena_of",
    "decode_arena_info",
    "decode_clock",
    "decode_command",
    "decode_context",
    "decode_diagnostics",
    "decode_executed",
    "decode_hand_pose",
    "decode_joints",
    "decode_learner_info",
    "decode_objects",
    "decode_observation",
    "decode_outcome",
    "decode_pause",
    "decode_program",
    "decode_program_status",
    "decode_provenance",
    "decode_reset",
    "decode_speed",
    "decode_step_mark",
    "decode_steps",
    "decode_trajectory",
    "decode_trajectory_key",
    "decode_verdict",
    "decode_weights",
    "encode_arena_info",
    "encode_clock",
    "encode_command",
    "encode_diagnostics",
    "encode_learner_info",
    "encode_observation",
    "encode_outcome",
    "encode_pause",
    "encode_program",
    "encode_program_status",
    "encode_provenance",
    "encode_reset",
    "encode_speed",
    "encode_steps",
    "encode_trajectory",
    "encode_verdict",
    "encode_weights",
    "header_stamp",
    "is_evaluation",
    "weights_checksum",
]
