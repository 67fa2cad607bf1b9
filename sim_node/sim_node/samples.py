"""The control step that stands, a few times a second: for who looks at an arena, however fast."""

from __future__ import annotations

from rclpy.node import Node

from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.wire import codec
from pa_ros.wire.records import StepContext
from sim_node.description import describe
from sim_node.session import Session

PERIOD_S = 0.25  # wall time


class Samples:
    """Published while someone looks, outside the control steps: they cost those nothing."""

    def __init__(self, node: Node, session: Session) -> None:
        self._session = session
        self._joint_names = describe(session).joint_names
        self._publishers = {part: topic.publisher(node) for part, topic in topics.SAMPLES.items()}
        steady_timer(node, PERIOD_S, self._show)

    def _show(self) -> None:
        if not any(one.get_subscription_count() for one in self._publishers.values()):
            return
        session, frame = self._session, self._session.frame
        context = StepContext(session.arena_id, frame.evaluation, frame.executed, frame.program)
        features, joints = codec.encode_observation(frame.observation, self._joint_names, context)
        verdict = codec.encode_verdict(frame.verdict, frame.evaluation, session.arena_id)
        for part, message in (("joints", joints), ("features", features), ("verdict", verdict)):
            self._publishers[part].publish(message)
