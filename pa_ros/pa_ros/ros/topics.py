"""The graph's topics and services: name, type and quality of service of each, in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from control_msgs.msg import JointJog
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from simulation_interfaces import srv as simulator
from std_msgs.msg import Bool, Float64MultiArray, String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import MarkerArray

from msgs_schema import msg, srv
from pa_ros.wire import Message, WireError


def quality(
    depth: int, latched: bool = False, reliable: bool = True, keep_all: bool = False
) -> QoSProfile:
    """A quality of service; `latched`: late subscribers receive the newest messages, too."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        history=HistoryPolicy.KEEP_ALL if keep_all else HistoryPolicy.KEEP_LAST,
        depth=depth,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def best_effort(profile: QoSProfile) -> QoSProfile:
    """The profile of a reader that hears every writer of new messages."""
    return quality(profile.depth, reliable=False)


# In lockstep at most three messages of a topic are under way, so a depth of 100 loses none.
# KEEP_ALL would let a subscriber that hangs block the arm.
STEP = quality(depth=100)
LATCHED = quality(depth=1, latched=True)
# A latched topic may have several publishers: a late subscriber needs the last message of each.
LATCHED_READER = quality(depth=100, latched=True)
# A lost trajectory would be a gap in the experience: KEEP_ALL never drops one.
EXPERIENCE = quality(depth=1, keep_all=True)
# Not 1: with policy_lag 1 an agent acts with the version before the newest, so a late agent needs
# both.
POLICY = quality(depth=4, latched=True)

# Pictures, and what is found in them, are large, and soon out of date.
PICTURE = quality(depth=2)

# Deep enough to answer all requests that arrive at once; ROS's default of 10 loses the others.
SERVICE = quality(depth=10_000)


@dataclass(frozen=True)
class Topic:
    """A topic with its quality of service on both sides.

    `name` is relative to the namespace of the node unless it begins with a slash.
    """

    name: str
    type: Any
    writer: QoSProfile
    reader: QoSProfile
    as_bytes: bool = False  # whether subscribers receive serialized messages

    def within(self, namespace: str) -> Topic:
        """The same topic in a namespace below the node's or, with a slash, anywhere."""
        return replace(self, name=f"{namespace.rstrip('/')}/{self.name}") if namespace else self

    def publisher(self, node: Node) -> Any:
        """A publisher of a node."""
        return node.create_publisher(self.type, self.name, self.writer)

    def subscribe(self, node: Node, callback: Callable[[Message], object]) -> Any:
        """Call back with each message."""
        return self._read(node, callback, self.reader)

    def parse(self, payload: bytes, names: Iterable[str] = ("",)) -> Message | None:
        """The message of bytes that a subscriber received; None unless one of the names is in it.

        Raises WireError (`wire.truncated`).
        """
        if not any(name.encode() in payload for name in names):
            return None
        try:
            return Message(deserialize_message(payload, self.type))
        except Exception as error:  # the middleware has its own
            raise WireError(self.name, "a message", error, code="wire.truncated") from error

    def _read(self, node: Node, callback: Any, qos: QoSProfile, **more: Any) -> Any:
        raw = self.as_bytes
        return node.create_subscription(self.type, self.name, callback, qos, raw=raw, **more)


class SensorTopic(Topic):
    """A topic that drivers of other people publish, reliably or with best effort.

    In DDS a reliable reader never hears a best-effort writer. One with best effort hears both, but
    it loses most pictures even of a reliable writer, so it is made where such a writer appears.
    """

    def subscribe(self, node: Node, callback: Callable[[Message], object]) -> Any:
        """Call back with each message, however it is sent."""
        replaced_by: list[Any] = []

        def receive(message: Message) -> None:
            if not replaced_by:
                callback(message)

        def hear_all(_event: object) -> None:
            # The first reader stays, unheard, as the executor may have queued more of its events.
            if not replaced_by and reader in node.subscriptions:
                node.get_logger().info(f"{self.name}: a publisher offers best effort: reads it so")
                replaced_by.append(self._read(node, callback, best_effort(self.reader)))

        events = SubscriptionEventCallbacks(incompatible_qos=hear_all)
        reader = self._read(node, receive, self.reader, event_callbacks=events)
        return reader


OBJECT_FEATURES = Topic("object_features", msg.ObjectFeatures, STEP, STEP)
JOINT_STATES = SensorTopic("joint_states", JointState, STEP, STEP)
JOINT_COMMANDS = Topic("joint_commands", msg.JointCommand, STEP, STEP)
VERDICT = Topic("verdict", msg.Verdict, STEP, STEP)
# Relative: each arena has its own clock. In the root namespace it is ROS's /clock.
CLOCK = Topic("clock", Clock, STEP, STEP)
ROS_CLOCK = Topic("/clock", Clock, STEP, STEP)
ARENA_INFO = Topic("arena_info", msg.ArenaInfo, LATCHED, LATCHED_READER)
# Subscriptions are VOLATILE, so that a plain `ros2 topic pub` reaches them: a TRANSIENT_LOCAL one
# would receive nothing from it. A late agent receives the program in force with each observation.
PROGRAM = Topic("program", msg.Program, LATCHED, STEP)
PROGRAM_STATUS = Topic("program_status", msg.ProgramStatus, LATCHED_READER, LATCHED_READER)
LEARNER_INFO = Topic("learner_info", msg.LearnerInfo, LATCHED, LATCHED_READER)
TRAJECTORIES = Topic("trajectories", msg.Trajectory, EXPERIENCE, EXPERIENCE)
POLICY_WEIGHTS = Topic("policy_weights", msg.PolicyWeights, POLICY, POLICY)
PROVENANCE = Topic("provenance", msg.Provenance, LATCHED, LATCHED_READER)
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, STEP, STEP)

# For ros2_control's controllers; remap them to the names of yours.
VELOCITY_COMMANDS = Topic("velocity_commands", Float64MultiArray, STEP, STEP)
JOINT_TRAJECTORY = Topic("joint_trajectory", JointTrajectory, STEP, STEP)
JOINT_JOG = Topic("joint_jog", JointJog, STEP, STEP)
SETPOINTS = {  # by the form of the command
    "velocity": VELOCITY_COMMANDS,
    "joint_trajectory": JOINT_TRAJECTORY,
    "joint_jog": JOINT_JOG,
}

# Relative, so that blocks of several arenas do not share frames. In the root namespace: /tf.
TF = SensorTopic("tf", TFMessage, STEP, STEP)
TF_STATIC = Topic("tf_static", TFMessage, LATCHED, LATCHED_READER)

# From a robot's sensors.
DETECTIONS = SensorTopic("detections", Detection3DArray, STEP, PICTURE)
# A person who moves a robot's arm in the agent's place, as MoveIt Servo takes it: hand or joints.
TAKEOVER = SensorTopic("takeover", TwistStamped, STEP, STEP)
TAKEOVER_JOINTS = SensorTopic("takeover_joints", JointJog, STEP, STEP)


def tracked_pose(name: str) -> Topic:
    """A topic with the pose of one object."""
    return SensorTopic(name, PoseStamped, STEP, STEP)


def valve(name: str) -> Topic:
    """A topic that switches a vacuum cup."""
    return Topic(name, Bool, STEP, STEP)


def holds(name: str) -> Topic:
    """A topic on which a gripper says whether it holds something."""
    return SensorTopic(name, Bool, STEP, STEP)


# For viewers.
ROBOT_DESCRIPTION = Topic("robot_description", String, LATCHED, LATCHED_READER)
MARKERS = Topic("markers", MarkerArray, STEP, STEP)
# The names that image_transport and camera drivers use.
CAMERA_IMAGE = SensorTopic("camera/image_raw", Image, PICTURE, STEP)
CAMERA_INFO = SensorTopic("camera/camera_info", CameraInfo, PICTURE, STEP)
# Pictures with boxes around the objects that were found.
CAMERA_TRACKS = Topic("camera/tracks", Image, PICTURE, STEP)

# A step from time to time, at any speed of the arena.
SAMPLES = OBJECT_FEATURES.within("samples")

RESET = ("reset", srv.Reset)
SPEED = ("speed", srv.SetSpeed)
# Of a robot that learns: stop, so that a person can scatter the blocks; continue with these.
SCATTER = ("scatter", Trigger)
RESUME = ("resume", Trigger)

# Of simulation_interfaces
DELETE_ENTITY = ("delete_entity", simulator.DeleteEntity)
GET_ENTITIES = ("get_entities", simulator.GetEntities)
GET_ENTITIES_STATES = ("get_entities_states", simulator.GetEntitiesStates)
GET_ENTITY_INFO = ("get_entity_info", simulator.GetEntityInfo)
GET_ENTITY_STATE = ("get_entity_state", simulator.GetEntityState)
GET_SIMULATION_STATE = ("get_simulation_state", simulator.GetSimulationState)
GET_SIMULATOR_FEATURES = ("get_simulator_features", simulator.GetSimulatorFeatures)
GET_SPAWNABLES = ("get_spawnables", simulator.GetSpawnables)
RESET_SIMULATION = ("reset_simulation", simulator.ResetSimulation)
SET_ENTITY_STATE = ("set_entity_state", simulator.SetEntityState)
SET_SIMULATION_STATE = ("set_simulation_state", simulator.SetSimulationState)
SPAWN_ENTITY = ("spawn_entity", simulator.SpawnEntity)
STEP_SIMULATION = ("step_simulation", simulator.StepSimulation)
