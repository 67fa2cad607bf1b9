"""What people look at, published only while somebody subscribes, and outside the control steps.

The arm's description, poses and markers for RViz; samples of the current step for tools that need
not see every step; pictures of a camera, and of an arena that sees, with what it found.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, cast

import numpy as np

from pa_ros.arena.camera import Camera, intrinsics, optical_pose
from pa_ros.arena.errors import RenderError
from pa_ros.arena.urdf import urdf
from pa_ros.core.experience import Body, Step
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.topics import Topic
from pa_ros.wire import Message
from pa_ros.wire.step import encode_clock, encode_joints, encode_step, encode_verdict
from pa_ros.wire.views import (
    OPTICAL_FRAME,
    encode_camera_info,
    encode_image,
    encode_markers,
    encode_text,
    encode_transforms,
)
from sim_node.entities import Entities, solids
from sim_node.session import Session

if TYPE_CHECKING:
    from pa_ros.perception.task import CameraTask

VIEWS_S = 0.1  # wall time between two sets of poses and markers
SAMPLES_S = 0.25  # wall time between two samples
CAMERA_POLL_S = 0.01  # wall time between two looks at the simulation's clock
# Wall time between two pictures while simulation time stops, because blocks may have been moved.
CAMERA_STILL_S = 1.0


class CameraView:
    """Pictures from a camera over the table, rendered in a thread.

    The arena never waits for a picture. While one is being rendered, later ones are skipped.
    """

    pose: Body  # of the optical frame

    def __init__(self, node: ManagedNode, session: Session) -> None:
        """Call after an episode has begun. Raises RenderError where there is no OpenGL."""
        self._node, self._session = node, session
        self._config = session.config.camera
        model, config = session.task.simulation.model, self._config
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="camera")
        shape = config.view, config.width, config.height
        self._camera = self._thread.submit(Camera, model, *shape).result()
        self._matrix, self.pose = intrinsics(model, *shape), optical_pose(model, config.view)
        self._image = topics.CAMERA_IMAGE.publisher(node)
        self._info = topics.CAMERA_INFO.publisher(node)
        self._rendering: Future[None] | None = None
        self._last = (-1, -CAMERA_STILL_S)  # period of simulation time, wall time of a picture
        self.pictures = 0
        steady_timer(node, CAMERA_POLL_S, self._poll)

    def close(self) -> None:
        """Free the camera; call before the node is destroyed."""
        self._thread.submit(self._camera.close)
        self._thread.shutdown()

    def _poll(self) -> None:
        watched = self._image.get_subscription_count() or self._info.get_subscription_count()
        busy = self._rendering is not None and not self._rendering.done()
        if busy or not watched or not self._node.active:
            return
        stamp_ns = self._session.current.observation.stamp_ns
        period, now = int(stamp_ns * self._config.rate_hz / 1e9), time.monotonic()
        if period == self._last[0] and now - self._last[1] < CAMERA_STILL_S:
            return
        self._last = period, now
        if self._rendering is not None and (error := self._rendering.exception()) is not None:
            lost = RenderError(f"expected a picture, got {type(error).__name__}: {error}")
            self._node.refusals.refuse("camera", lost)
        self._camera.look(self._session.task.simulation)
        self._rendering = self._thread.submit(self._publish, stamp_ns)

    def _publish(self, stamp_ns: int) -> None:
        size = self._config.width, self._config.height
        self._image.publish(encode_image(self._camera.picture(), OPTICAL_FRAME, stamp_ns))
        self._info.publish(encode_camera_info(self._matrix, *size, OPTICAL_FRAME, stamp_ns))
        self.pictures += 1


class Tracks:
    """What the cameras of an arena that sees show now, with a box around each object found."""

    def __init__(self, node: ManagedNode, session: Session) -> None:
        """The session's task is a CameraTask."""
        self._node, self._session = node, session
        self._out = topics.CAMERA_TRACKS.publisher(node)
        steady_timer(node, SAMPLES_S, self._show)

    def _show(self) -> None:
        if self._out.get_subscription_count() and self._node.active:
            stamp_ns = self._session.current.observation.stamp_ns
            picture = cast("CameraTask", self._session.task).drawn()
            self._out.publish(encode_image(picture, OPTICAL_FRAME, stamp_ns))


class Views:
    """The arm's URDF, the poses of hand, blocks and camera, and the blocks as markers."""

    def __init__(
        self, node: ManagedNode, session: Session, entities: Entities, camera: CameraView | None
    ) -> None:
        """Call after an episode has begun."""
        self._node, self._session, self._entities = node, session, entities
        self._tf = topics.TF.publisher(node)
        self._tf_static = topics.TF_STATIC.publisher(node)
        fixed = {"base": Body.at_rest(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))}
        if camera is not None:
            fixed[OPTICAL_FRAME] = camera.pose
        self._tf_static.publish(encode_transforms(fixed, 0))
        self._markers = topics.MARKERS.publisher(node)
        self._shown = 0  # markers in the last message
        limits, model = self._session.arena.joint_speed_limits, self._session.task.simulation.model
        self._description = topics.ROBOT_DESCRIPTION.publisher(node)
        self._description.publish(encode_text(urdf(model, self._session.arena.arm, limits)))
        steady_timer(node, VIEWS_S, self._show)

    def _show(self) -> None:
        if not self._node.active:
            return
        stamp_ns = self._session.current.observation.stamp_ns
        if self._tf.get_subscription_count():
            moving = {entity.name: entity.body for entity in self._entities.matching()}
            self._tf.publish(encode_transforms(moving, stamp_ns))
        if self._markers.get_subscription_count():
            blocks = solids(self._session.task.simulation.model, self._entities.matching()[1:])
            self._markers.publish(encode_markers(blocks, stamp_ns, self._shown))
            self._shown = len(blocks)


class StepViews:
    """Each step's joints, verdict and time for tools, while somebody subscribes."""

    def __init__(self, node: ManagedNode, joint_names: tuple[str, ...]) -> None:
        encoders: tuple[tuple[Topic, Callable[[Step, Message], Message]], ...] = (
            (
                topics.JOINT_STATES,
                lambda step, into: encode_joints(step.observation, joint_names, into),
            ),
            (topics.VERDICT, encode_verdict),
            (topics.CLOCK, lambda step, into: encode_clock(step.observation.stamp_ns, into)),
        )
        # Each message is filled again at each step.
        self._views = [(one.publisher(node), one.type(), encode) for one, encode in encoders]

    def publish(self, step: Step) -> None:
        """Publish the views of a step."""
        for publisher, message, encode in self._views:
            if publisher.get_subscription_count():
                publisher.publish(encode(step, message))


class Samples:
    """The current step, four times a second however fast the arena is."""

    def __init__(self, node: ManagedNode, session: Session) -> None:
        self._node, self._session = node, session
        self._out = topics.SAMPLES.publisher(node)
        steady_timer(node, SAMPLES_S, self.show)

    def show(self) -> None:
        """Publish the current step now."""
        if self._out.get_subscription_count() and self._node.active:
            self._out.publish(encode_step(self._session.current))
