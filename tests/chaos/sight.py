"""A camera between the arena and its agent, and pictures that show nothing."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from rclpy.node import Node

from chaos.faults import STOPPED_S, Fault
from chaos.stage import Stage
from pa_ros.ros import topics
from pa_ros.ros.environment import ros_arguments
from pa_ros.ros.executor import steady_timer
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.views import OPTICAL_FRAME, encode_image

CAMERA: Final = "camera_node"
SEEN: Final = {t.name: f"seen/{t.name}" for t in (topics.OBJECT_FEATURES, topics.ARENA_INFO)}
SIDE: Final = 240  # px, of the pictures that the shipped agent knows
PERIOD_S: Final = 0.1


class Sighted(Stage):
    """An arena in real time, `camera_node`, and an agent that follows what it sees."""

    def __init__(self, folder: Path, node: Node, kind: str) -> None:
        super().__init__(folder, node, kind)
        self._seen, self._noise = 0, list[Any]()
        topics.OBJECT_FEATURES.within("seen").subscribe(node, self._on_seen)
        self._pictures = topics.CAMERA_IMAGE.publisher(node)
        self._random = np.random.default_rng(0)

    @property
    def progress(self) -> int:
        return self._seen

    def _on_seen(self, _: object) -> None:
        self._seen += 1

    def begin_noise(self) -> None:
        """Publish a picture of noise in each period, beside those of the camera."""
        self._noise.append(steady_timer(self.node, PERIOD_S, self._publish_noise))

    def end_noise(self) -> None:
        self.node.destroy_timer(self._noise.pop())

    def _publish_noise(self) -> None:
        picture = self._random.integers(0, 256, (SIDE, SIDE, 3), np.uint8)
        stamp_ns = header_stamp(self.observer.last["object_features"])
        self._pictures.publish(encode_image(picture, OPTICAL_FRAME, stamp_ns))

    def _command(self, name: str, beside: bool) -> list[str]:
        python, option, module, *rest = super()._command(name, beside)
        if name == CAMERA:
            module = "sim_node.camera.main"
        rules = ros_arguments(remaps=SEEN)[1:] if name == "agent_node" else []
        return [python, option, module, *rest, *rules]


def sight_faults() -> list[Fault]:
    """Pictures of noise among good ones."""

    def stage_of(stage: Stage) -> Sighted:
        assert isinstance(stage, Sighted)
        return stage

    return [
        Fault("camera_node: pictures of noise", lambda stage: stage_of(stage).begin_noise(),
              lambda stage: stage_of(stage).end_noise(), STOPPED_S, kind="sighted"),
    ]  # fmt: skip
