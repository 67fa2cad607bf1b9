"""The control step that stands, a few times a second: for who looks at an arena, however fast."""

from __future__ import annotations

from rclpy.node import Node

from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.wire.step import StepContext, encode_observation, encode_verdict
from sim_node.description import describe
from sim_node.services import Steered

PERIOD_S = 0.25  # wall time


class Samples:
    """Published while someone looks, outside the control steps: they cost those nothing."""

    def __init__(self, node: Node, arena: Steered) -> None:
        self._arena = arena
        self._joint_names = describe(arena.session).joint_names
        self._publishers = {part: topic.publisher(node) for part, topic in topics.SAMPLES.items()}
        steady_timer(node, PERIOD_S, self._show)

    def _show(self) -> None:
        looked_at = any(one.get_subscription_count() for one in self._publishers.values())
        if not looked_at or not self._arena.active:
            return
        session, frame = self._arena.session, self._arena.session.frame
        context = StepContext(session.arena_id, frame.evaluation, frame.executed, frame.program)
        features, joints = encode_observation(frame.observation, self._joint_names, context)
        verdict = encode_verdict(frame.verdict, frame.evaluation, session.arena_id)
        for part, message in (("joints", joints), ("features", features), ("verdict", verdict)):
            self._publishers[part].publish(message)
