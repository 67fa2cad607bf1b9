"""The arena's arm as a "real" one, for rehearsals with robot_node: joint_states, tf and a camera
come out, joint velocities go in, and nothing else (docs/robot.md)."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from pa_ros.arena import Episode, Kind, condition_named, design_named, generate, preset_named
from pa_ros.arena.appearance import look_of
from pa_ros.arena.camera import Camera, intrinsics, optical_pose
from pa_ros.arena.model import mjcf
from pa_ros.core.clock import now_ns
from pa_ros.core.experience import Body
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.node_main import run_node
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.fields import read_array, write_stamp
from pa_ros.wire.views import encode_camera_info, encode_image, encode_transforms

CONFIG, DESIGN = preset_named("fast"), design_named("3-D")
KINDS = [  # of objects with the tags 0, 1, 2 and 3
    Kind(color="RED", shape="CUBE"),
    Kind(color="GREEN", shape="CUBE"),
    Kind(color="RED", shape="SPHERE"),
    Kind(color="BLUE", shape="CYLINDER"),
]
PERIOD_S = 0.02  # of the driver: 50 joint states per second
TAG_M, SHEET_M = 0.05, 0.0625  # edge of a tag's black square, and of the sheet with its white edge
SIZE, PICTURE_S = (1600, 1200), 0.2  # px; wall time between two pictures
CAMERA_FRAME, VIEW = "camera_optical_frame", "above"


def tag_picture(number: int, pixels: int = 16) -> np.ndarray:
    """The sheet of AprilTag 36h11 `number`, white edge included, [height, width] grey."""
    from cv2 import aruco

    tags = aruco.getPredefinedDictionary(aruco.DICT_APRILTAG_36h11)
    square = aruco.generateImageMarker(tags, number, 8)[::-1, ::-1]  # OpenCV's is upside down
    return np.pad(square, 1, constant_values=255).repeat(pixels, 0).repeat(pixels, 1)


def names_of(kinds: Sequence[Kind]) -> dict[str, str]:
    """The body of each object of some kinds, by the object's name."""
    return {str(kind).lower().replace(" ", "_"): f"block{i}" for i, kind in enumerate(kinds)}


OBJECTS = names_of(KINDS)


def scene_of(number: int, kinds: Sequence[Kind] = KINDS) -> Episode:
    """Four objects of some kinds at places that the arena draws."""
    drawn = generate(CONFIG, DESIGN, condition_named("train", DESIGN), 0, number)
    blocks = (replace(b, kind=kind) for b, kind in zip(drawn.blocks, kinds, strict=True))
    return replace(drawn, blocks=tuple(blocks))


class SimulatedArm:
    """Arm and objects of a scene in MuJoCo, on its own, with a tag above each object if wanted."""

    def __init__(self, scene: int = 0, tags: bool = False, kinds: Sequence[Kind] = KINDS) -> None:
        drawn = scene_of(scene, kinds)
        looks = [look_of(block.kind) for block in drawn.blocks]
        spec = mujoco.MjSpec.from_string(mjcf(CONFIG, looks))
        for i, look in enumerate(looks):
            spec.geom(f"block{i}").rgba = [float(part) for part in look.rgba.split()]
            if tags:
                _add_tag(spec, i)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.joints = len(CONFIG.joint_speed_limits)
        self.data.qpos[: self.joints] = drawn.arm_start
        places = self.data.qpos[self.joints :].reshape(-1, 7)
        for place, block, look in zip(places, drawn.blocks, looks, strict=True):
            half = block.yaw / 2
            place[:] = block.x, block.y, look.rest_height, np.cos(half), 0, 0, np.sin(half)
        mujoco.mj_forward(self.model, self.data)
        self.velocity = np.zeros(self.joints)  # rad/s, as commanded last

    def advance(self, seconds: float = PERIOD_S) -> None:
        """Move as commanded last."""
        limits = CONFIG.joint_speed_limits
        self.data.ctrl[:] = np.clip(self.velocity, np.negative(limits), limits)
        mujoco.mj_step(self.model, self.data, round(seconds / self.model.opt.timestep))
        mujoco.mj_forward(self.model, self.data)

    def body(self, name: str) -> Body:
        """Pose of `hand` or `block0` … in the base's frame."""
        body = self.data.body(name)
        return Body.at_rest(body.xpos.copy(), np.roll(body.xquat, -1))


class ArmDriver(Node):
    """What a driver, a robot_state_publisher and a camera driver publish, on one node."""

    def __init__(self) -> None:
        super().__init__("simulated_arm")
        scene = self.declare_parameter("scene", 0).value
        self.tags = self.declare_parameter("tags", False).value  # else tf has the objects' poses
        self.names = [f"joint_{i}" for i in range(1, 7)]
        self.refusals = Refusals(self.get_logger().warning)
        self.joints, self.tf = topics.JOINT_STATES.publisher(self), topics.TF.publisher(self)
        self.fixed = topics.TF_STATIC.publisher(self)
        self.image = topics.CAMERA_IMAGE.publisher(self)
        self.info = topics.CAMERA_INFO.publisher(self)
        self.thread, self.camera, self.rendering = ThreadPoolExecutor(1), None, None
        self.place(scene)
        commands = self.refusals.guard("velocity_commands", self.on_velocity)
        topics.VELOCITY_COMMANDS.subscribe(self, commands)
        steady_timer(self, PERIOD_S, self.step)
        if self.tags:
            steady_timer(self, PICTURE_S, self.take_picture)

    def scatter(self, scene: int, kinds: Sequence[Kind] = KINDS) -> None:
        """Put objects where a scene of the arena has them. The arm stays where it is."""
        before = self.arm.data
        self.place(scene, kinds)
        now, count = self.arm.data, len(self.names)
        now.qpos[:count], now.qvel[:count] = before.qpos[:count], before.qvel[:count]
        mujoco.mj_forward(self.arm.model, now)

    def place(self, scene: int, kinds: Sequence[Kind] = KINDS) -> None:
        """Put arm and objects where a scene of the arena begins."""
        self.arm, self.objects = SimulatedArm(scene, self.tags, kinds), names_of(kinds)
        self.matrix = intrinsics(self.arm.model, VIEW, *SIZE)
        if self.tags:  # a new scene is a new model, and a camera belongs to its thread
            if self.camera is not None:
                self.thread.submit(self.camera.close).result()
            self.camera = self.thread.submit(Camera, self.arm.model, VIEW, *SIZE).result()
            placed = {CAMERA_FRAME: optical_pose(self.arm.model, VIEW)}
            self.fixed.publish(encode_transforms(placed, 0))

    def on_velocity(self, message) -> None:
        self.arm.velocity[:] = read_array("velocity", message.data, np.float64, (6,))

    def step(self, seconds: float = PERIOD_S) -> None:
        self.arm.advance(seconds)
        now, data, count = now_ns(), self.arm.data, len(self.names)
        state = JointState(name=self.names)
        write_stamp(state.header.stamp, now)
        state.position, state.velocity = data.qpos[:count].tolist(), data.qvel[:count].tolist()
        self.joints.publish(state)
        self.tf.publish(encode_transforms({"hand": self.arm.body("hand")}, now))
        if not self.tags:
            self.see({name: self.arm.body(body) for name, body in self.objects.items()}, now)

    def see(self, objects: dict[str, Body], stamp_ns: int) -> None:
        """Tell where objects are, as if a camera had found them."""
        self.tf.publish(encode_transforms(objects, stamp_ns))

    def take_picture(self) -> None:
        if self.rendering is None or self.rendering.done():
            self.camera.look(self.arm)
            self.rendering = self.thread.submit(self.publish_picture, now_ns())

    def publish_picture(self, stamp_ns: int) -> None:
        self.image.publish(encode_image(self.camera.picture(), CAMERA_FRAME, stamp_ns))
        self.info.publish(encode_camera_info(self.matrix, *SIZE, CAMERA_FRAME, stamp_ns))

    def close(self) -> None:
        if self.camera is not None:
            self.thread.submit(self.camera.close)
        self.thread.shutdown()


def _add_tag(spec: mujoco.MjSpec, number: int) -> None:
    """Lay the sheet of a tag on an object."""
    name, picture = f"tag{number}", tag_picture(number)
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.width, texture.height, texture.nchannel = picture.shape[1], picture.shape[0], 3
    texture.data = np.stack([picture] * 3, -1).tobytes()
    material = spec.add_material(name=name)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    spec.body(f"block{number}").add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[SHEET_M / 2, SHEET_M / 2, 0.0005],
        pos=[0, 0, 0.0305],
        material=name,
        contype=0,
        conaffinity=0,
        mass=0,
    )


if __name__ == "__main__":
    raise SystemExit(run_node("simulated_arm", ArmDriver))
