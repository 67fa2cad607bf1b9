"""The message and service types of the graph, so that only this room imports message packages."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from msgs_schema.msg import (
    ArenaInfo,
    JointCommand,
    ObjectFeatures,
    PolicyWeights,
    Program,
    ProgramStatus,
    Provenance,
    SequenceMark,
    Tensor,
    Trajectory,
    Verdict,
)
from msgs_schema.srv import Reset, SetSpeed, Step

__all__ = [
    "ArenaInfo",
    "Clock",
    "DiagnosticArray",
    "DiagnosticStatus",
    "JointCommand",
    "JointState",
    "KeyValue",
    "ObjectFeatures",
    "PolicyWeights",
    "Program",
    "ProgramStatus",
    "Provenance",
    "Reset",
    "SequenceMark",
    "SetBool",
    "SetSpeed",
    "Step",
    "Tensor",
    "Trajectory",
    "Verdict",
]
