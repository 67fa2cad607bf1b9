"""What an arena offers beside its control steps."""

from __future__ import annotations

from rclpy.node import Node

from pa_ros.ros.refusals import Refusals
from sim_node.camera import CameraView
from sim_node.entities import Entities
from sim_node.samples import Samples
from sim_node.services import ArenaServices, Steered
from sim_node.simulator import SimulatorServices
from sim_node.views import Views


class Components:
    """Its own services, the standard simulator's, what viewers show, a camera, a thin sample."""

    def __init__(self, node: Node, arena: Steered, refusals: Refusals) -> None:
        """An episode has begun. Raises RenderError for a camera without OpenGL."""
        ArenaServices(node, arena, refusals)
        entities = Entities(arena.session)
        SimulatorServices(node, arena, entities, refusals)
        with_camera = arena.session.config.camera.rate_hz > 0
        self.camera = CameraView(node, arena, refusals) if with_camera else None
        Views(node, arena, entities, self.camera)
        Samples(node, arena)

    def close(self) -> None:
        """Call before the arena goes."""
        if self.camera is not None:
            self.camera.close()
