"""A robot.yaml for the simulated Jaco, and the measurements that its sensors would send."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pa_ros.acting.executing import Actor
from pa_ros.arena.simulation import Simulation
from pa_ros.core.experience import Float64, Step
from pa_ros.core.extensions import load
from pa_ros.language import parse
from pa_ros.ros import topics
from pa_ros.wire.fields import header_stamp
from pa_ros.wire.program import ProgramRequest, encode_program
from pa_ros.wire.step import Command, encode_command
from sim_node.robot.arm import RealArm
from sim_node.robot.frames import Placed
from sim_node.robot.settings import read_robot

(SIMULATED,) = load([str(Path(__file__).parents[2] / "docs/examples/simulated_arm.py")])
KINDS, NAMES = tuple(SIMULATED.KINDS), tuple(SIMULATED.OBJECTS)
CONFIG, DESIGN = SIMULATED.CONFIG, SIMULATED.DESIGN
PERIOD_S = 0.1
DRY = topics.VELOCITY_COMMANDS.within("dry_run")


def robot_values(**changes: Any) -> dict[str, Any]:
    """The values of a robot.yaml, with four objects measured by tf."""
    whole = {
        "design": "3-D",
        "base_frame": "world",
        "hand_frame": "hand",
        "speed_scale": 1.0,
        "max_acceleration": 0.0,
        "workspace": {"lower": [-0.8, -0.8, 0.0], "upper": [0.8, 0.8, 0.8]},
        "joints": [{"name": f"joint_{i}"} for i in range(1, 7)],
        "objects": {
            name: {"words": list(kind.values()), "frame": name}
            for name, kind in zip(NAMES, KINDS, strict=True)
        },
    }
    return {**whole, **changes}


def learning_robot(folder: Path, dry_run: bool) -> str:
    """A robot.yaml of an arm that learns; the file's name."""
    file = folder / f"{dry_run}.yaml"
    learning = {"episode_s": 1.0}
    values = robot_values(dry_run=dry_run, learning=learning, speed_scale=0.5, relay=False)
    file.write_text(yaml.safe_dump(values, sort_keys=False))
    return str(file)


def pressed(probe: Any, service: tuple[str, Any]) -> Any:
    """The answer of a service of std_srvs/Trigger."""
    client = probe.create_client(service[1], service[0])
    assert probe.until(client.service_is_ready)
    answer = client.call_async(service[1].Request())
    assert probe.until(answer.done)
    return answer.result()


class Rehearsal:
    """A RealArm whose sensors measure a simulated arm, in a time of its own."""

    def __init__(self, index: int = 0, **changes: Any) -> None:
        self.arm = RealArm(read_robot(robot_values(**changes)))
        self.plant = Simulation(CONFIG, DESIGN.schema)
        self.plant.place(SIMULATED.scene_of(index))
        self.now_s = 100.0
        self.lost: set[str] = set()  # names whose measurements don't arrive
        self.measure()

    @property
    def stamp_ns(self) -> int:
        return round(self.now_s * 1e9)

    def measure(self) -> None:
        """Send what the sensors see now."""
        plant, now = self.plant, (self.stamp_ns, self.now_s)
        if "joints" not in self.lost:
            self.arm.joints.add(plant.joint_position, plant.joint_velocity, *now)
        poses, _ = plant.body_states()
        for name, pose in zip(("hand", *NAMES), poses, strict=True):
            if name not in self.lost:
                measured = np.array([*pose[:3], *np.roll(pose[3:], -1)])
                self.arm.frames.add("world", name, Placed(measured, *now))

    def advance(self, velocity: Float64) -> None:
        """Move for one period, and measure."""
        self.plant.advance(velocity)
        self.now_s += PERIOD_S
        self.measure()

    def observe(self) -> Step:
        return self.arm.observe(self.now_s, self.stamp_ns)

    def execute(self, text: str, actor: Actor, steps: int = 100, hold: int = 10) -> bool:
        """Whether an agent holds a program for `hold` periods within so many steps."""
        self.arm.submit(ProgramRequest("p", text))
        program, held = parse(text, DESIGN.vocabulary), 0
        for _ in range(steps):
            step = self.observe()
            held = held + 1 if step.verdict.satisfied else 0
            if held > hold:
                return True
            action = actor.act(step.observation, program)
            velocity = self.arm.velocity(self.command(action))
            self.advance(self.arm.allowed(velocity))
        return False

    def command(self, action: Any) -> Command:
        """A command that answers the newest observation."""
        seen = self.arm.seen
        return Command(0, seen.step, seen.stamp_ns, "a", 0, np.asarray(action, np.float32))


class Table:
    """robot_node, the simulated arm, and an agent that always turns the arm's base."""

    user: Any = None

    def __init__(self, probe: Any, files: Any = None) -> None:
        self.probe, self.files, (*_, self.driver) = probe, files, probe.nodes
        self.lost: set[str] = set()
        self.agent, self.count, self.dry = True, 0, list[Any]()
        joints, tf = self.driver.joints, self.driver.tf
        send_joints, send_tf = joints.publish, tf.publish
        joints.publish = lambda m: None if "joints" in self.lost else send_joints(m)
        tf.publish = lambda m: send_tf(self.without_lost(m))
        probe.create_subscription(DRY.type, DRY.name, self.dry.append, 10)
        self.commands = probe.speaker(topics.JOINT_COMMANDS)
        features = topics.OBJECT_FEATURES
        features.subscribe(probe, self.on_step)
        programs = probe.speaker(topics.PROGRAM)
        programs.publish(encode_program(ProgramRequest("p", "NEAR(HAND, BLUE)")))
        assert probe.until(lambda: probe.count(topics.PROGRAM_STATUS) > 0)

    def without_lost(self, message: Any) -> Any:
        message.transforms = [t for t in message.transforms if t.child_frame_id not in self.lost]
        return message

    def on_step(self, message: Any) -> None:
        if self.agent and message.program:
            self.answer(message)

    def answer(self, message: Any) -> None:
        """Send a command for a step."""
        self.count += 1
        action = np.array([0.5, 0, 0, 0, 0, 0], np.float32)
        answered = message.step, header_stamp(message)
        self.commands.publish(
            encode_command(Command(0, *answered, "pusher", 0, action, 1, self.count))
        )

    def moves(self) -> bool:
        return self.probe.until(lambda: self.driver.arm.velocity[0] > 0.2)

    def stops(self, says: str = "") -> bool:
        told = lambda: says in self.probe.message("robot_node")  # noqa: E731
        return self.probe.until(lambda: not self.driver.arm.velocity.any() and told())
