"""What viewers show of the arena: the arm's URDF, poses in a fixed frame, blocks as markers."""

from __future__ import annotations

from rclpy.node import Node

from pa_ros.arena.urdf import urdf
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.wire.views import encode_markers, encode_text, encode_transform
from sim_node.camera import FRAME, CameraView
from sim_node.entities import Entities, solids
from sim_node.services import Steered

PERIOD_S = 0.1  # wall time


class Views:
    """Published while someone looks, outside the control steps: they cost those nothing."""

    def __init__(
        self, node: Node, arena: Steered, entities: Entities, camera: CameraView | None
    ) -> None:
        self._arena, self._session = arena, arena.session
        self._entities, self._camera = entities, camera
        self._described = False
        self._description = topics.ROBOT_DESCRIPTION.publisher(node)
        self._transforms = topics.TRANSFORMS.publisher(node)
        self._markers = topics.MARKERS.publisher(node)
        self._shown = 0  # markers in the newest message
        steady_timer(node, PERIOD_S, self._show)

    def _show(self) -> None:
        if not self._arena.active:
            return
        if not self._described:
            self._described = True  # the model is there only once an episode has begun
            arena, model = self._session.arena, self._session.task.simulation.model
            description = urdf(model, arena.arm, arena.joint_speed_limits)
            self._description.publish(encode_text(description))
        stamp_ns = self._session.frame.observation.stamp_ns
        if self._transforms.get_subscription_count():
            shown = {entity.name: entity.body for entity in self._entities.matching()}
            if self._camera is not None:
                shown[FRAME] = self._camera.pose
            for name, body in shown.items():
                self._transforms.publish(encode_transform(name, body, stamp_ns))
        if self._markers.get_subscription_count():
            blocks = solids(self._session.task.simulation.model, self._entities.matching()[1:])
            self._markers.publish(encode_markers(blocks, stamp_ns, self._shown))
            self._shown = len(blocks)
