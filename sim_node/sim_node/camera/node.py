"""A camera as a ROS node: it replaces the blocks in observations by those that it sees in pictures.

An arena, or a robot's node, says where the arm is and what the verifier thinks. This node publishes
the same steps again under `seen/`, with the objects that the camera found; agents follow those.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from pa_ros.arena import preset_named
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Step
from pa_ros.learning.checkpoints import camera_of
from pa_ros.perception import sight_of
from pa_ros.perception.errors import PerceptionError
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, OK, WARN
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.peers import PeerMonitor
from pa_ros.ros.settings import NodeSettings
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info, encode_arena_info
from pa_ros.wire.step import arena_of, decode_step, encode_step
from pa_ros.wire.views import OPTICAL_FRAME, decode_camera_info, decode_image, encode_image

if TYPE_CHECKING:  # it imports OpenCV
    from pa_ros.perception.sight import Sight

SEEN = "seen"  # namespace of what is published
KEPT = 20  # steps, one of which a picture is of
PATIENCE, TICK_S = 0.7, 0.005  # the share of a control period that a step waits for its picture
DO_CLOCKS_AGREE = (
    "do steps arrive, and do both clocks agree? After a machine's clock was set, restart robot_node"
)
SAME_PX = 2.0  # greatest difference of two cameras' matrices


class SeeingConfig(NodeSettings):
    """Parameters of camera_node."""

    perception: str = Field(
        "shipped:camera", description="checkpoint of the agent that sees, and of its camera"
    )
    timeout_s: float = Field(
        1.0, gt=0, le=60, description="greatest age of a picture; then no step is published"
    )


class CameraNode(ManagedNode):
    """Sees blocks through the camera that an agent was trained with."""

    config: SeeingConfig

    def __init__(self) -> None:
        super().__init__("camera_node", SeeingConfig)

    def configure(self) -> None:
        self._calibration = camera_of(Path(self.config.perception))
        self._arenas = PeerMonitor[ArenaDescription]("arena", self._see_for)
        self._sight: Sight | None = None
        self._steps: deque[Step] = deque(maxlen=KEPT)  # of this episode
        self._early: Message | None = None  # a picture of the next step
        self._waiting_since: float | None = None  # s; the newest step waits for its picture
        self._looked_at = time.monotonic()  # when the newest usable picture arrived, s
        self._calibrated = False  # whether camera_info is that of the calibration
        self._out = self.advertise(topics.OBJECT_FEATURES.within(SEEN))
        self._info = self.advertise(topics.ARENA_INFO.within(SEEN))
        self._tracks = topics.CAMERA_TRACKS.publisher(self)
        self.subscribe(topics.ARENA_INFO, self._on_arena)
        self.subscribe(topics.OBJECT_FEATURES, self._on_step)
        self.subscribe(topics.CAMERA_INFO, self._on_info)
        self.subscribe(topics.CAMERA_IMAGE, self._on_picture)
        steady_timer(self, TICK_S, self._wait)

    def cleanup(self) -> None:
        if self._sight is not None:
            self._sight.close()

    # The arena's steps

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        self._arenas.described(arena.arena_id, arena)

    def _see_for(self, arena: ArenaDescription) -> None:
        """Begin with another arena. PaError for one whose blocks have other properties, or with
        places, which its pictures show to people."""
        if arena.world.schema.bodiless:
            raise PaError(
                f"perception: expected an arena without {sorted(arena.world.schema.bodiless)}, "
                "which a camera would take for blocks; sim_node's perception sees such a world",
                code="perception.camera",
            )
        config = preset_named(arena.preset or "fast", arena.arm)
        sight = sight_of(config, self._calibration)
        if (cameras := len(sight.views)) > 1:
            sight.close()
            raise PaError(
                f"perception: expected an agent that sees through one camera, got {cameras}",
                code="perception.camera",
            )
        schema = sight.cameras.schema(arena.world.schema)
        if self._sight is not None:
            self._sight.close()
        self._sight, self._calibrated = sight, False
        self._steps.clear()
        self._waiting_since = None
        seen = replace(arena.world, schema=schema)
        described = replace(arena, world=seen, perception=self._calibration)
        self._info.publish(encode_arena_info(described))

    def _on_step(self, message: Message) -> None:
        if not self._arenas.received(arena_of(message)) or self._sight is None:
            return
        step = decode_step(message)
        last = self._steps[-1] if self._steps else step
        before, now = last.observation, step.observation
        same = (before.episode, last.evaluation) == (now.episode, step.evaluation)
        if not same or now.step < before.step:  # another scene, or the same one again
            self._steps.clear()
            self._sight.begin()
        self._steps.append(step)
        self._waiting_since = time.monotonic()
        if (early := self._early) is not None:
            self._on_picture(early)

    def _wait(self) -> None:
        """Publish a step whose picture does not arrive in time: commands must not be late."""
        arena, since = self._arenas.current, self._waiting_since
        if arena is not None and since is not None:
            if time.monotonic() - since > PATIENCE * arena.control_period:
                self._publish(self._steps[-1])

    def _publish(self, step: Step) -> None:
        """Publish a step with the objects seen, unless the camera has stopped, or saw nothing yet
        of this episode."""
        assert self._sight is not None  # a step of its arena has arrived
        if not self.active or self._age > self.config.timeout_s or not self._sight.looked:
            return
        self._waiting_since = None
        objects = self._sight.objects(step.observation.hand_pose)
        seen = replace(step.observation, objects=objects)
        self._out.publish(encode_step(replace(step, observation=seen)))

    # Pictures

    def _on_info(self, message: Message) -> None:
        self._calibrated = False
        matrix = decode_camera_info(message).matrix
        if self._sight is None:
            return
        expected = self._sight.views[0].matrix
        if not np.allclose(matrix, expected, rtol=0, atol=SAME_PX):
            raise PaError(
                f"camera_info.k: expected the camera that the agent learned with, "
                f"{expected.round(1).tolist()}, got {matrix.round(1).tolist()}",
                code="perception.camera",
            )
        self._calibrated = True

    def _on_picture(self, message: Message) -> None:
        sight, arena = self._sight, self._arenas.current
        if sight is None or arena is None or not (self._steps and self._calibrated):
            return
        stamp_ns, picture = decode_image(message)
        apart_s = (stamp_ns - self._steps[-1].observation.stamp_ns) / 1e9
        if abs(apart_s) > KEPT * arena.control_period:
            raise PerceptionError(
                f"image.header.stamp: expected that of a step, got {apart_s:.1f} s after the newest"
                f": {DO_CLOCKS_AGREE}",
                code="perception.stamp",
            )
        of = min(self._steps, key=lambda step: abs(step.observation.stamp_ns - stamp_ns))
        later_ns = stamp_ns - of.observation.stamp_ns
        # The picture of a step may be served before the step.
        self._early = message if later_ns > arena.control_period * 5e8 else None
        if abs(later_ns) > arena.control_period * 5e8:
            return
        if why := sight.look([picture], of.observation.joint_position):
            raise PerceptionError(why, code="perception.picture")
        self._looked_at = time.monotonic()
        if of is self._steps[-1] and self._waiting_since is not None:
            self._publish(of)
        if self._tracks.get_subscription_count():
            self._tracks.publish(encode_image(sight.drawn([picture]), OPTICAL_FRAME, stamp_ns))

    @property
    def _age(self) -> float:
        """Wall time since the newest usable picture, s."""
        return time.monotonic() - self._looked_at

    # Health

    def collect(self) -> tuple[int, str, dict[str, str]]:
        if self._arenas.fault:
            return ERROR, self._arenas.fault, {}
        if self._sight is None or not self._steps:
            return WARN, "waits for an arena (arena_info, object_features)", {}
        if self._age > self.config.timeout_s:
            names = f"{topics.CAMERA_IMAGE.name} and {topics.CAMERA_INFO.name}"
            seen = f"the arm holds: expected {names}, got none of use for {self._age:.1f} s"
            if self._early is not None:
                seen += f", or only some that are later than every step: {DO_CLOCKS_AGREE}"
            return WARN, seen, {}
        level = WARN if self.refusals.newest else OK
        return level, f"sees {len(self._sight.tracker.tracks)} objects", {}
