"""The message and service types of the graph, so that only this room imports message packages."""

from __future__ import annotations

from typing import NewType

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from msgs_schema.msg import (
    ArenaInfo,
    JointCommand,
    LearnerInfo,
    ObjectFeatures,
    PolicyWeights,
    Program,
    ProgramStatus,
    Provenance,
    SequenceMark,
    Signature,
    Tensor,
    Trajectory,
    Verdict,
)
from msgs_schema.srv import Reset, SetSpeed, Step

Message = NewType("Message", object)
"""A message as it came or goes, whose fields are this room's affair: nobody else can name one."""

__all__ = [
    "ArenaInfo",
    "Clock",
    "DiagnosticArray",
    "DiagnosticStatus",
    "JointCommand",
    "JointState",
    "KeyValue",
    "LearnerInfo",
    "Message",
    "ObjectFeatures",
    "PolicyWeights",
    "Program",
    "ProgramStatus",
    "Provenance",
    "Reset",
    "SequenceMark",
    "SetBool",
    "SetSpeed",
    "Signature",
    "Step",
    "Tensor",
    "Trajectory",
    "Verdict",
]
