"""Publishes object_features from the poses that a tag tracker measures (docs/robot.md)."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from pa_ros.arena import Kind
from pa_ros.arena.task import Verifier
from pa_ros.core.experience import Observation, Step
from pa_ros.language import parse
from pa_ros.ros import topics
from pa_ros.ros.node_main import run_node
from pa_ros.ros.refusals import Refusals
from pa_ros.wire.arena import decode_arena_info
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import decode_program_status
from pa_ros.wire.step import decode_joints, encode_step
from pa_ros.wire.views import decode_pose
from pa_ros.world import Scoring, reward_from
from pa_ros.world.poses import objects_from_poses

# Greatest age of a pose. Without newer ones the agent receives no observation, and the arm stops.
OLDEST_S = 0.5


class FeaturesFromPoses(Node):
    def __init__(self) -> None:
        super().__init__("features_from_poses")
        labels = self.declare_parameter("labels", "labels.yaml").value
        self.driver = self.declare_parameter(
            "driver", "/sim_node"
        ).value  # the node that accepts programs
        self.labels = yaml.safe_load(Path(labels).read_text())  # object: {group: value}
        self.names = ("hand", *self.labels)
        self.poses, self.frame, self.arena, self.program, self.step = {}, "", None, ("", ""), 0
        self.verifier = None  # says at each step whether the program is satisfied
        self.features = topics.OBJECT_FEATURES.publisher(self)
        self.refusals = Refusals(self.get_logger().warning)
        pose = topics.Topic("", PoseStamped, topics.STEP, topics.STEP)
        for topic, react in (
            (topics.ARENA_INFO, self.on_arena),
            (topics.PROGRAM_STATUS, self.on_status),
            (topics.JOINT_STATES, self.on_joints),
            *((replace(pose, name=f"poses/{n}"), partial(self.on_pose, n)) for n in self.names),
        ):
            topic.subscribe(self, self.refusals.guard(topic.name, react))

    def on_arena(self, message) -> None:
        self.arena = decode_arena_info(message)

    def on_status(self, message) -> None:
        status = decode_program_status(message)
        if self.arena is not None and status.node == self.driver and status.accepted:
            self.program = status.program_id, status.canonical
            world, kinds = self.arena.world, [Kind(**values) for values in self.labels.values()]
            reward = reward_from(self.arena.reward)
            scoring = Scoring.of(world.relations, self.arena.thresholds, reward)
            program = parse(status.canonical, world.vocabulary)
            self.verifier = Verifier(program, kinds, scoring, may_name_nothing=True)

    def on_pose(self, name, message) -> None:
        frame, pose = decode_pose(message)
        self.poses = self.poses if frame == self.frame else {}  # poses of another frame are dropped
        self.frame, self.poses[name] = frame, (time.monotonic(), pose)

    def on_joints(self, message) -> None:
        fresh = [pose for at, pose in self.poses.values() if at > time.monotonic() - OLDEST_S]
        if self.arena is None or len(fresh) < len(self.names):
            return
        seen = np.array([self.poses[name][1] for name in self.names])  # [1 + n, 7]
        objects = objects_from_poses(self.arena.world.schema, [*self.labels.values()], seen)
        (program_id, text), when = self.program, header_stamp(message)
        joints = decode_joints(message, self.arena.joint_names)
        self.step += 1
        seen = Observation(0, self.step, when, objects, *joints, 0, program_id, seen[0])
        verdict = self.verifier and self.verifier.verdict(objects, seen.hand_pose)
        step = Step(seen, verdict, text, arena_id=self.arena.arena_id)
        self.features.publish(encode_step(step))

    def close(self) -> None:
        pass


if __name__ == "__main__":
    raise SystemExit(run_node("features_from_poses", FeaturesFromPoses))
