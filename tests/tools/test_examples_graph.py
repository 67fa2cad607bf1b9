"""The runnable examples of docs/robot.md execute programs, and are as short as they claim."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped

from helpers.processes import node_command, running
from helpers.waiting import DEADLINE_S
from pa_ros.cli.main import main
from pa_ros.core.experience import Float32
from pa_ros.ros import topics
from pa_ros.ros.executor import spin_until
from pa_ros.tools.arm import Arm
from pa_ros.tools.client import client_node
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.step import decode_step

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs/examples"


def node(name: str) -> list[str]:
    parameters = str(ROOT / name / "config/execute.yaml")
    return node_command(name, "--ros-args", "--params-file", parameters)


def example(name: str) -> list[str]:
    return [sys.executable, str(EXAMPLES / name)]


@pytest.mark.graph
@pytest.mark.parametrize(
    ("nodes", "programs"),
    [
        ([example("robot_driver.py"), node("agent_node")],
         {"NEAR(HAND, AND(RED, CUBE))": 0, "NEAR(HAND, RAD)": 2}),
        ([node("sim_node"), example("controller.py")], {"NEAR(HAND, AND(RED, CUBE))": 0}),
    ],
    ids=["robot", "controller"],
)  # fmt: skip
def test_an_example_executes_a_program_and_the_robot_refuses_another(nodes, programs, tmp_path):
    with running(tmp_path, *nodes):
        for program, status in programs.items():
            assert main(["send", program, "--wait", "--timeout", "60"]) == status, program


class Tracker:
    """A tag tracker's stand-in: the arena's own poses, in its fixed frame, as PoseStamped."""

    def __init__(self, node) -> None:
        self._node, self._speakers, self.silent = node, {}, False
        self.newest = {"object_features": 0, "of_arena": 0}  # stamps, ns
        self.features: dict[str, dict[int, Float32]] = {"object_features": {}, "of_arena": {}}
        topics.TF.subscribe(node, self.on_tf)
        for name, heard in self.features.items():
            topic = replace(topics.OBJECT_FEATURES, name=name)
            topic.subscribe(node, partial(self.on_features, name, heard))

    def on_tf(self, message) -> None:
        for transform in () if self.silent else message.transforms:
            self.on_transform(transform)

    def on_transform(self, message) -> None:
        name, placed = message.child_frame_id, message.transform
        measured = PoseStamped(header=message.header)
        place = measured.pose.position
        place.x, place.y, place.z = (getattr(placed.translation, axis) for axis in "xyz")
        measured.pose.orientation = placed.rotation
        if name not in self._speakers:
            topic = topics.Topic(f"poses/{name}", PoseStamped, topics.STEP, topics.STEP)
            self._speakers[name] = topic.publisher(self._node)
        self._speakers[name].publish(measured)

    def on_features(self, name, heard, message) -> None:
        self.newest[name] = header_stamp(message)
        if not message.program:
            heard[self.newest[name]] = decode_step(message).observation.objects

    def agrees(self) -> bool:
        """Whether features of a step of an arm at rest have come from both, and are the same."""
        ours, arenas = self.features.values()
        both = sorted(set(ours) & set(arenas))
        return bool(both) and np.allclose(ours[both[-1]], arenas[both[-1]], atol=1e-4)

    def late_s(self) -> float:
        """For how long only the arena has sent features."""
        return (self.newest["of_arena"] - self.newest["object_features"]) / 1e9


@pytest.mark.graph
def test_features_from_poses_are_the_arenas_and_the_agent_acts_on_them(tmp_path):
    arena = [*node("sim_node"), "-r", "object_features:=of_arena"]
    labels = ["--ros-args", "-p", f"labels:={EXAMPLES / 'labels.yaml'}"]
    nodes = [arena, [*example("features_from_poses.py"), *labels], node("agent_node")]
    with running(tmp_path, *nodes), client_node("tracker") as tracker:
        seen = Tracker(tracker)
        assert spin_until(tracker, seen.agrees, DEADLINE_S)
        with Arm(patience=DEADLINE_S) as arm, ThreadPoolExecutor() as beside:
            executed = beside.submit(arm.execute, "NEAR(HAND, CYLINDER)")
            assert spin_until(tracker, executed.done, DEADLINE_S)
            assert executed.result().success
        assert spin_until(tracker, lambda: seen.late_s() < 1, DEADLINE_S)
        seen.silent = True
        assert spin_until(tracker, lambda: seen.late_s() > 1, DEADLINE_S), "old poses are used"
