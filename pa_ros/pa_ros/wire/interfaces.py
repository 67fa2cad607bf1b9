"""The message and service types of the graph, so that only this room imports message packages."""

from __future__ import annotations

from typing import NewType

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TransformStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from msgs_schema.action import ExecuteProgram, SimulateSteps
from msgs_schema.msg import (
    ArenaInfo,
    Bounds,
    EntityCategory,
    EntityFilters,
    EntityState,
    JointCommand,
    LearnerInfo,
    ObjectFeatures,
    PolicyWeights,
    Program,
    ProgramStatus,
    Provenance,
    Resource,
    Result,
    SequenceMark,
    Signature,
    SimulationState,
    SimulatorFeatures,
    Spawnable,
    TagsFilter,
    Tensor,
    Trajectory,
    Verdict,
)
from msgs_schema.srv import (
    DeleteEntity,
    GetEntities,
    GetEntitiesStates,
    GetEntityInfo,
    GetEntityState,
    GetSimulationState,
    GetSimulatorFeatures,
    GetSpawnables,
    Reset,
    ResetSimulation,
    SetEntityState,
    SetSimulationState,
    SetSpeed,
    SpawnEntity,
    Step,
    StepSimulation,
)

Message = NewType("Message", object)
"""A message as it came or goes, whose fields are this room's affair: nobody else can name one."""

__all__ = [
    "ArenaInfo",
    "Bounds",
    "CameraInfo",
    "Clock",
    "DeleteEntity",
    "DiagnosticArray",
    "DiagnosticStatus",
    "EntityCategory",
    "EntityFilters",
    "EntityState",
    "ExecuteProgram",
    "Float64MultiArray",
    "GetEntities",
    "GetEntitiesStates",
    "GetEntityInfo",
    "GetEntityState",
    "GetSimulationState",
    "GetSimulatorFeatures",
    "GetSpawnables",
    "Image",
    "JointCommand",
    "JointState",
    "JointTrajectory",
    "JointTrajectoryPoint",
    "KeyValue",
    "LearnerInfo",
    "Marker",
    "MarkerArray",
    "Message",
    "ObjectFeatures",
    "PolicyWeights",
    "PoseStamped",
    "Program",
    "ProgramStatus",
    "Provenance",
    "Reset",
    "ResetSimulation",
    "Resource",
    "Result",
    "SequenceMark",
    "SetBool",
    "SetEntityState",
    "SetSimulationState",
    "SetSpeed",
    "Signature",
    "SimulateSteps",
    "SimulationState",
    "SimulatorFeatures",
    "SpawnEntity",
    "Spawnable",
    "Step",
    "StepSimulation",
    "String",
    "TagsFilter",
    "Tensor",
    "Trajectory",
    "TransformStamped",
    "Verdict",
]
