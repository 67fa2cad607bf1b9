"""The graph's topics and services: name, type and quality of service of each, in one table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from msgs_schema import msg, srv
from pa_ros.wire import Message


def _reliable(depth: int, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


# In lockstep at most three messages of a topic are under way, so that depth loses nothing; unlike
# KEEP_ALL, it doesn't let a stuck third party hold up the arm.
STEP = _reliable(depth=100)
LATCHED = _reliable(depth=1, latched=True)
# Readers of latched topics with several writers keep one place for each.
LATCHED_READER = _reliable(depth=100, latched=True)
# A trajectory lost would be a hole in the experience: KEEP_ALL never drops one.
EXPERIENCE = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL, depth=1
)
# Not 1: with policy_lag 1 an agent acts with the version before the newest, and a late agent
# must find both.
POLICY = _reliable(depth=4, latched=True)

# Large, and soon out of date.
PICTURE = _reliable(depth=2)

# Requests in flight are all answered, however long the one before them takes.
SERVICE = _reliable(depth=1000)


@dataclass(frozen=True)
class Topic:
    """`name` is relative to the node's namespace unless it begins with a slash."""

    name: str
    type: Any
    writer: QoSProfile
    reader: QoSProfile

    def within(self, namespace: str) -> Topic:
        """The same topic in a namespace below the node's (or, with a slash, anywhere)."""
        return replace(self, name=f"{namespace.rstrip('/')}/{self.name}") if namespace else self

    def publisher(self, node: Node) -> Any:
        """What a node publishes with."""
        return node.create_publisher(self.type, self.name, self.writer)

    def subscribe(self, node: Node, callback: Callable[[Message], object]) -> Any:
        """Call back with each message."""
        return node.create_subscription(self.type, self.name, callback, self.reader)


OBJECT_FEATURES = Topic("object_features", msg.ObjectFeatures, STEP, STEP)
JOINT_STATES = Topic("joint_states", JointState, STEP, STEP)
JOINT_COMMANDS = Topic("joint_commands", msg.JointCommand, STEP, STEP)
VERDICT = Topic("verdict", msg.Verdict, STEP, STEP)
# Relative: in the root namespace it is ROS's /clock; of several arenas, each has its own.
CLOCK = Topic("clock", Clock, STEP, STEP)
ROS_CLOCK = Topic("/clock", Clock, STEP, STEP)
ARENA_INFO = Topic("arena_info", msg.ArenaInfo, LATCHED, LATCHED_READER)
# Read VOLATILE, as a plain `ros2 topic pub` writes it: a TRANSIENT_LOCAL reader would never hear
# that, and both sides would say so. Who comes late has the arena's program from program_status.
PROGRAM = Topic("program", msg.Program, LATCHED, STEP)
PROGRAM_STATUS = Topic("program_status", msg.ProgramStatus, LATCHED_READER, LATCHED_READER)
LEARNER_INFO = Topic("learner_info", msg.LearnerInfo, LATCHED, LATCHED_READER)
TRAJECTORIES = Topic("trajectories", msg.Trajectory, EXPERIENCE, EXPERIENCE)
POLICY_WEIGHTS = Topic("policy_weights", msg.PolicyWeights, POLICY, POLICY)
PROVENANCE = Topic("provenance", msg.Provenance, LATCHED, LATCHED_READER)
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, STEP, STEP)

# To ros2_control's controllers, which have their names: remap.
VELOCITY_COMMANDS = Topic("velocity_commands", Float64MultiArray, STEP, STEP)
JOINT_TRAJECTORY = Topic("joint_trajectory", JointTrajectory, STEP, STEP)

# For viewers; poses by themselves, as `tf2_msgs` is not on the Python index.
ROBOT_DESCRIPTION = Topic("robot_description", String, LATCHED, LATCHED_READER)
TRANSFORMS = Topic("transforms", TransformStamped, STEP, STEP)
MARKERS = Topic("markers", MarkerArray, STEP, STEP)
RELEVANCE_MARKERS = Topic("relevance_markers", MarkerArray, STEP, STEP)
# By the names that image_transport and camera drivers use.
CAMERA_IMAGE = Topic("camera/image_raw", Image, PICTURE, STEP)
CAMERA_INFO = Topic("camera/camera_info", CameraInfo, PICTURE, STEP)

# A whole step now and then, however fast the arena is.
SAMPLES = {
    "features": OBJECT_FEATURES.within("samples"),
    "verdict": VERDICT.within("samples"),
}

RESET = ("reset", srv.Reset)
SPEED = ("speed", srv.SetSpeed)

# simulation_interfaces 2.1
DELETE_ENTITY = ("delete_entity", srv.DeleteEntity)
GET_ENTITIES = ("get_entities", srv.GetEntities)
GET_ENTITIES_STATES = ("get_entities_states", srv.GetEntitiesStates)
GET_ENTITY_INFO = ("get_entity_info", srv.GetEntityInfo)
GET_ENTITY_STATE = ("get_entity_state", srv.GetEntityState)
GET_SIMULATION_STATE = ("get_simulation_state", srv.GetSimulationState)
GET_SIMULATOR_FEATURES = ("get_simulator_features", srv.GetSimulatorFeatures)
GET_SPAWNABLES = ("get_spawnables", srv.GetSpawnables)
RESET_SIMULATION = ("reset_simulation", srv.ResetSimulation)
SET_ENTITY_STATE = ("set_entity_state", srv.SetEntityState)
SET_SIMULATION_STATE = ("set_simulation_state", srv.SetSimulationState)
SPAWN_ENTITY = ("spawn_entity", srv.SpawnEntity)
STEP_SIMULATION = ("step_simulation", srv.StepSimulation)
