"""A camera over the table: pictures while someone looks, made on a thread of their own."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor

from rclpy.node import Node

from pa_ros.arena.camera import Camera, intrinsics, optical_pose
from pa_ros.arena.errors import RenderError
from pa_ros.core.body import Body
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.views import encode_camera_info, encode_image
from sim_node.services import Steered

FRAME = "camera_optical_frame"
LOOK_S = 0.02  # wall time between two looks at the clock
STILL_S = 1.0  # wall time; where time stands still, a picture of what may have been moved


class CameraView:
    """The arena waits for no picture: those that would come too soon are left out."""

    pose: Body  # of the optical frame

    def __init__(self, node: Node, arena: Steered, refusals: Refusals) -> None:
        """An episode has begun. Raises RenderError where there is no OpenGL."""
        self._arena, self._refusals = arena, refusals
        session = self._session = arena.session
        self._config = session.config.camera
        model, config = session.task.simulation.model, self._config
        self._painter = ThreadPoolExecutor(1, thread_name_prefix="camera")
        shape = config.view, config.width, config.height
        self._camera = self._painter.submit(Camera, model, *shape).result()
        self._matrix, self.pose = intrinsics(model, *shape), optical_pose(model, config.view)
        self._image = topics.CAMERA_IMAGE.publisher(node)
        self._info = topics.CAMERA_INFO.publisher(node)
        self._under_way: Future[None] | None = None
        self._seen = (-1, -STILL_S)  # period of simulation time, wall time of the last picture
        self.pictures = 0
        steady_timer(node, LOOK_S, self._look)

    def close(self) -> None:
        """Call before the node is destroyed."""
        self._painter.submit(self._camera.close)
        self._painter.shutdown()

    def _look(self) -> None:
        watched = self._image.get_subscription_count() or self._info.get_subscription_count()
        busy = self._under_way is not None and not self._under_way.done()
        if busy or not watched or not self._arena.active:
            return
        stamp_ns = self._session.frame.observation.stamp_ns
        period, now = int(stamp_ns * self._config.rate_hz / 1e9), time.monotonic()
        if period == self._seen[0] and now - self._seen[1] < STILL_S:
            return
        self._seen = period, now
        if self._under_way is not None and (error := self._under_way.exception()) is not None:
            lost = RenderError(f"expected a picture, got {type(error).__name__}: {error}")
            self._refusals.refuse("camera", lost)
        self._camera.look(self._session.task.simulation)
        self._under_way = self._painter.submit(self._publish, stamp_ns)

    def _publish(self, stamp_ns: int) -> None:
        size = self._config.width, self._config.height
        self._image.publish(encode_image(self._camera.picture(), FRAME, stamp_ns))
        self._info.publish(encode_camera_info(self._matrix, *size, FRAME, stamp_ns))
        self.pictures += 1
