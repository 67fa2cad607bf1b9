"""An arm that learns without being reset, through the standard topics alone (docs/robot.md): the
frames, minutes and scatters that it needs, and how well its hand was kept in its box.

The arm is simulated, late, noisy and lossy. Unless `--real-time`, its clock waits for the nodes.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml
from rosgraph_msgs.msg import Clock

from laboratory.benchmarks.paced_robot import PACED
from pa_ros.agents import greedy
from pa_ros.arena import Design, ReachTask, design_named, preset_for
from pa_ros.arena.camera import optical_pose
from pa_ros.arena.simulation import Simulation
from pa_ros.bags.experience import Experience
from pa_ros.bags.reader import Bag
from pa_ros.bags.verify import verify
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.experience import Body, Float64, Observation, PolicySnapshot
from pa_ros.core.extensions import load
from pa_ros.core.text import Report
from pa_ros.evaluation.evaluate import TRAINING_SCORES_SEED, run_episodes
from pa_ros.ros import topics
from pa_ros.ros.executor import release, spin_until, steady_timer
from pa_ros.tools.domain import use_free_domain
from pa_ros.wire import Message
from pa_ros.wire.diagnostics import decode_diagnostics
from pa_ros.wire.fields import write_stamp
from pa_ros.wire.learning import decode_weights
from pa_ros.world.poses import IDENTITY, in_base

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
(SIMULATED,) = load([str(EXAMPLES / "simulated_arm.py")])
BELOW_TAG = np.array([0.0, 0.0, -0.031, *IDENTITY[3:]])  # an object's center, as in robot.yaml
PERIOD_S, DRIVER_S = 0.1, 0.05  # of control, and of the driver where the clock is paced
MARGIN_M = 0.02  # of the box (docs/robot.md)
TINY = 1e-6  # rad/s
BLOCKS = 4  # on the table at once
REACHED, FEW_SCENES, KEEP_FRAMES = 0.9, 20, 3000  # what is solved; how often that is looked at
STUCK_S, LOOK_S = 2.0, 0.5  # wall time
STARTED_NS = 1_000_000_000_000
SIZE = 800, 600  # px of a picture of tags, where the clock is paced
FORGOTTEN_NS = 3_000_000_000  # after which robot_node counts no block that it does not see


@dataclass(frozen=True)
class Faults:
    """What is wrong with the arm and its sensors."""

    pictures_s: float = 0.1  # from a picture to its objects' poses
    reacts_s: float = 0.0  # from a command to its motion
    noise_m: float = 0.005  # standard deviation of each coordinate of an object
    noise_rad: float = np.deg2rad(2.0)  # of its turn about each axis
    lost: float = 0.02  # chance in a second that an object is lost for one
    dropped: float = 0.02  # share of messages, in and out


class TouchingArm(SIMULATED.SimulatedArm):  # type: ignore[misc,name-defined]
    """Arm, blocks that it moves, and places, which have no bodies."""

    def __init__(self, scene: int, tags: bool, kinds: Any) -> None:
        if tags:
            raise ConfigError("on_the_arm: --tags: expected a design without places")
        simulation = Simulation(SIMULATED.CONFIG, SIMULATED.DESIGN.schema)
        simulation.place(SIMULATED.scene_of(scene, kinds))
        self.model, self.data = simulation.model, simulation.data
        self.joints = SIMULATED.CONFIG.joints
        self.velocity = np.zeros(self.joints)
        mujoco.mj_forward(self.model, self.data)


class RehearsedArm(SIMULATED.ArmDriver):  # type: ignore[misc,name-defined]
    """The simulated arm with faults, whose true motion is watched all the time."""

    def __init__(
        self, design: Design, faults: Faults, seed: int, box: Any, scale: float, paced: bool
    ) -> None:
        self.rng, self.faults = np.random.default_rng(seed), faults
        self.design, self.paced, self.now_ns = design, paced, STARTED_NS
        self.scale, self.entered = scale, False  # of speed; the hand has been in its box
        self.late: deque[tuple[int, Any]] = deque()  # velocities, and when they count
        self.seen: deque[tuple[int, dict[str, Body]]] = deque()
        self.lost: dict[str, int] = {}  # until when
        self.box, self.outside_m, self.too_fast, self.samples, self.fastest = box, 0.0, 0, 0, 0.0
        if paced:
            own = {"steady_timer": lambda *_: None, "now_ns": lambda: self.now_ns, "SIZE": SIZE}
            vars(SIMULATED).update(own)
        super().__init__()
        self.scenes = 0
        self.scatter_next()
        self.clock = topics.ROS_CLOCK.publisher(self)
        if self.tags:
            (self.tracker,) = load([str(EXAMPLES / "tag_tracker.py")])
            self.detector = self.tracker.finder()
        if paced:
            PACED.subscribe(self, self.on_done)
            steady_timer(self, LOOK_S, self.unstick)
        self.moved_at = time.monotonic()

    def place(self, scene: int, kinds: Any = None) -> None:
        """Put arm and objects where a scene begins; by default the first blocks of the design."""
        super().place(scene, kinds or [*self.design.pool[:BLOCKS], *self.design.places])

    def scatter_next(self) -> None:
        """Put some of the blocks, and all places, elsewhere, as a person would."""
        pool = self.design.pool
        kinds = [pool[i] for i in self.rng.permutation(len(pool))[:BLOCKS]]
        self.scenes += 1
        self.scatter(1000 + self.scenes, [*kinds, *self.design.places])

    # Time

    def on_done(self, message: Any) -> None:
        done_ns, awaited_ns, answered_ns = map(int, message.data)
        if done_ns == self.now_ns and answered_ns >= awaited_ns:
            self.tick()

    def unstick(self) -> None:
        if time.monotonic() - self.moved_at > STUCK_S:
            self.tick()

    def tick(self) -> None:
        self.moved_at = time.monotonic()
        self.now_ns += round(DRIVER_S * 1e9)
        self.step(DRIVER_S)
        message = Clock()
        write_stamp(message.clock, self.now_ns)
        self.clock.publish(message)

    # Faults

    @property
    def drops(self) -> bool:
        return bool(self.rng.random() < self.faults.dropped)

    def on_velocity(self, message: Any) -> None:
        limits = self.scale * np.array(SIMULATED.CONFIG.joint_speed_limits)
        self.too_fast += bool((np.abs(message.data) > limits + TINY).any())
        if not self.drops:
            self.late.append((SIMULATED.now_ns() + int(self.faults.reacts_s * 1e9), message))

    def step(self, seconds: float = SIMULATED.PERIOD_S) -> None:
        while self.late and self.late[0][0] <= SIMULATED.now_ns():
            super().on_velocity(self.late.popleft()[1])
        super().step(seconds)
        hand, speeds = self.arm.body("hand").position, self.arm.data.qvel[: self.arm.joints]
        lower, upper = self.box
        outside = float(np.max([hand - upper, lower - hand]))
        self.samples, self.entered = self.samples + 1, self.entered or outside <= 0
        if self.entered:
            self.outside_m = max(self.outside_m, outside - MARGIN_M)
        if self.tags and self.paced and self.now_ns % round(SIMULATED.PICTURE_S * 1e9) == 0:
            self.take_picture()
        limits = self.scale * np.array(SIMULATED.CONFIG.joint_speed_limits)
        self.fastest = max(self.fastest, float(np.max(np.abs(speeds) / limits)))

    def take_picture(self) -> None:
        """See the objects whose tags are found."""
        self.camera.look(self.arm)
        picture = self.thread.submit(self.camera.picture).result()
        lens = _pose(optical_pose(self.arm.model, SIMULATED.VIEW))
        names, found = list(self.objects), {}
        for number, tag in self.tracker.find(self.detector, picture, self.matrix).items():
            center = in_base(lens, in_base(_pose(tag), BELOW_TAG))
            found[names[number]] = Body.at_rest(center[:3], center[3:])
        self.see(found, SIMULATED.now_ns())

    def see(self, objects: dict[str, Body], stamp_ns: int) -> None:
        faults, rng = self.faults, self.rng
        driver_s = DRIVER_S if self.paced else SIMULATED.PERIOD_S
        seconds = SIMULATED.PICTURE_S if self.tags else driver_s
        for name in objects:
            if rng.random() < faults.lost * seconds:
                self.lost[name] = stamp_ns + 1_000_000_000
        found = {
            name: self.noisy(body)
            for name, body in objects.items()
            if self.lost.get(name, 0) <= stamp_ns
        }
        self.seen.append((stamp_ns, found))
        while self.seen and self.seen[0][0] + int(faults.pictures_s * 1e9) <= stamp_ns:
            when_ns, then = self.seen.popleft()
            if then and not self.drops:
                super().see(then, when_ns)

    def noisy(self, body: Body) -> Body:
        place = body.position + self.rng.normal(0, self.faults.noise_m, 3)
        turn = body.quaternion.copy()
        turn[:3] += self.rng.normal(0, self.faults.noise_rad / 2, 3)
        return Body.at_rest(place, turn / np.linalg.norm(turn))


def _pose(body: Body) -> Float64:
    return np.concatenate([body.position, body.quaternion])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--design", default="2-L", help="what is learned (%(default)s)")
    parser.add_argument("--seeds", type=int, default=1, help="how many runs (%(default)s)")
    parser.add_argument("--first-seed", type=int, default=0, help="of them (%(default)s)")
    parser.add_argument("--frames", type=int, default=36_000, help="of a run (%(default)s)")
    parser.add_argument("--minutes", type=float, default=10.0, help="between two scatters")
    parser.add_argument("--scenes", type=int, default=50, help="of each score (%(default)s)")
    parser.add_argument("--reacts", type=float, default=0.1, help="delay of the arm, s")
    parser.add_argument("--told", type=float, default=0.1, help="arm_delay_s in robot.yaml")
    parser.add_argument("--floor", type=float, default=0.02, help="of the box, m")
    parser.add_argument("--scale", type=float, default=1.0, help="of speed: speed_scale")
    parser.add_argument("--ramp", type=float, default=0.0, help="max_acceleration, rad/s²")
    parser.add_argument("--shake", type=float, default=4.0, help="exploration.acceleration")
    parser.add_argument("--off", type=float, default=0.0, help="of the hand's frame, along x, m")
    parser.add_argument("--starts-from", default="", help="a run or shipped:NAME, to continue from")
    parser.add_argument("--warmup", type=int, default=5000, help="frames before the first update")
    parser.add_argument("--tags", action="store_true", help="a camera finds the objects' tags")
    parser.add_argument("--real-time", action="store_true", help="do not pace the clock")
    parser.add_argument("--bag", type=Path, help="folder for a recording of each run")


def run(options: argparse.Namespace) -> Report:
    """The worst of the seeds' scores in new scenes, and the means of what they needed."""
    import rclpy

    from pa_ros.ros.environment import prepare_environment

    os.environ.pop("ROS_DOMAIN_ID", None)
    use_free_domain()
    prepare_environment()
    runs = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        rclpy.init(args=["--ros-args", "-p", f"tags:={str(options.tags).lower()}"])
        try:
            one = _learn(options, seed)
        finally:
            rclpy.try_shutdown()
        print(f"seed {seed}: {one}", flush=True)
        runs.append(one)
    worst = {"held_out_worst": min, "relearned": min, "outside_box_mm": max, "above_speed": max,
             "fastest_joint": max}  # fmt: skip
    return {
        f"arm.{name}": float(worst.get(name, np.mean)([one[name] for one in runs]))
        for name in runs[0]
    }


def _learn(options: argparse.Namespace, seed: int) -> dict[str, float]:
    """Learn with one seed on an arm of its own."""
    design = design_named(options.design)
    described = yaml.safe_load((EXAMPLES / "robot.yaml").read_text())
    there = (*design.pool, *design.places)
    names = {kind: str(kind).lower().replace(" ", "_") for kind in there}
    described |= {
        "dry_run": False,
        "relay": options.real_time,
        "arm_delay_s": options.told,
        "speed_scale": options.scale,
        "max_acceleration": options.ramp,
        "design": options.design,
        "preset": design.preset,
        "hand_offset": [options.off, 0.0, 0.0],
        "objects": {n: {"words": [*k.values()], "frame": n} for k, n in names.items()},
        "learning": {
            "blocks": BLOCKS + len(design.places),
            "scatter_every_min": options.minutes,
            "seed": seed,
        },
    }
    described["workspace"]["lower"][2] = options.floor
    box = tuple(np.array(described["workspace"][end]) for end in ("lower", "upper"))
    exact = {"noise_m": 0.0, "noise_rad": 0.0} if options.tags else {}  # the camera has its own
    faults = replace(Faults(), reacts_s=options.reacts, **exact)
    config = preset_for(design)
    if config.arm_touches_blocks:
        own = {"CONFIG": config, "DESIGN": design, "SimulatedArm": TouchingArm}
        vars(SIMULATED).update(own)
    arm = RehearsedArm(design, faults, seed, box, options.scale, not options.real_time)
    started: list[Any] = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.yaml"
        file.write_text(yaml.safe_dump(described, sort_keys=False))
        robot = "sim_node.robot.main" if options.real_time else "laboratory.benchmarks.paced_robot"
        commands = [
            [robot, "--ros-args", "-p", f"robot:={file}", "-p", "autostart:=true"],
            ["learner_node.main", "--ros-args", "-p", f"out:={folder}/run", "-p", f"seed:={seed}",
             "-p", f"learner.exploration.acceleration:={options.shake}",
             "-p", f"learner.replay.warmup_frames:={options.warmup}",
             "-p", f"learner.starts_from:='{options.starts_from}'"],
            ["agent_node.main", "--ros-args", "-p", "learning:=true", "-p", "weights:=topic",
             "-p", f"seed:={seed}"],
        ]  # fmt: skip
        if options.bag is not None:
            options.bag.mkdir(parents=True, exist_ok=True)
            commands.insert(0, ["pa_ros", "record", str(options.bag / str(seed))])
        try:
            started = [subprocess.Popen([sys.executable, "-P", "-m", *one]) for one in commands]
            ended = lambda: any(process.poll() is not None for process in started)  # noqa: E731
            found = _Session(arm, options, design, ended).run()
        finally:
            for process in reversed(started):
                process.terminate()
                process.wait()
            arm.close()
            release(arm)
            arm.destroy_node()
    if options.bag is not None:
        with Bag(options.bag / str(seed)) as bag:
            told = verify(Experience.read(bag), arena=False)
        found["relearned"] = float(told.equal)
        print(f"bag: {told.compared} versions of the weights are equal {told.difference}"
              f"{told.incomplete}", flush=True)  # fmt: skip
    return found


class _Session:
    """A person beside the arm, who scatters the blocks when asked, and looks at the scores."""

    def __init__(
        self, arm: RehearsedArm, options: argparse.Namespace, design: Any, ended: Callable[[], bool]
    ) -> None:
        """`ended`: whether a node has ended, so that nothing more is learned."""
        self.arm, self.options, self.ended = arm, options, ended
        self.frames, self.asked, self.scattered, self.answer = 0, False, False, None
        self.scattered_ns = 0
        self.policy: PolicySnapshot | None = None
        self.first: tuple[float, float] | None = None  # scores at the first look
        self.needed: tuple[int, int] | None = None  # frames and scatters; it stays solved then
        self.kept: list[tuple[int, int, PolicySnapshot]] = []  # with their frames and scatters
        speeds = tuple(options.scale * np.array(SIMULATED.CONFIG.joint_speed_limits))
        arena = SIMULATED.CONFIG.changed(joint_speed_limits=speeds)
        self.task = ReachTask(arena, design, TRAINING_SCORES_SEED)
        self.resume = arm.create_client(topics.RESUME[1], topics.RESUME[0])
        self.next = 0 if options.starts_from else KEEP_FRAMES
        topics.DIAGNOSTICS.subscribe(arm, self.on_diagnostics)
        topics.POLICY_WEIGHTS.subscribe(arm, self.on_weights)
        steady_timer(arm, LOOK_S, self.help)

    def on_diagnostics(self, message: Message) -> None:
        for entry in decode_diagnostics(message):
            self.frames = int(float(entry.values.get("frames", self.frames)))
            if "steps_to_scatter" in entry.values or "scatter the blocks" in entry.message:
                self.asked = "scatter the blocks" in entry.message

    def on_weights(self, message: Message) -> None:
        try:
            self.policy = decode_weights(message).snapshot
        except PaError as error:
            print(error)

    def help(self) -> None:
        """Scatter the blocks if the robot asks for it, and press resume until it continues."""
        if not self.asked:
            self.answer, self.scattered = None, False
        elif not self.scattered:
            self.scattered, self.scattered_ns = True, SIMULATED.now_ns()
            if self.frames:
                self.arm.scatter_next()
        elif SIMULATED.now_ns() - self.scattered_ns < FORGOTTEN_NS:
            pass  # the robot still counts the blocks that were there before
        elif self.answer is None and self.resume.service_is_ready():
            self.answer = self.resume.call_async(self.resume.srv_type.Request())
        elif self.answer is not None and self.answer.done() and not self.answer.result().success:
            print(self.answer.result().message, flush=True)
            self.answer = None
            if self.options.tags:  # the hand hides one: put it elsewhere
                self.scattered_ns = SIMULATED.now_ns()
                self.arm.scatter_next()
        if self.frames >= self.next and self.policy is not None:
            self.kept.append((self.frames, self.arm.scenes - 1, self.policy))
            self.next = self.frames + KEEP_FRAMES
            if self.arm.paced:  # else the arm would stand still meanwhile
                self.score_kept()

    def score_kept(self) -> None:
        for frames, scatters, policy in self.kept:
            share, reward = self.score(policy, FEW_SCENES)
            print(f"{frames} frames, {scatters} scatters: held out {share:.2f}, "
                  f"reward {reward:.3f}", flush=True)  # fmt: skip
            self.first = (share, reward) if self.first is None else self.first
            self.needed = (self.needed or (frames, scatters)) if share >= REACHED else None
        self.kept.clear()

    def score(self, policy: PolicySnapshot, scenes: int) -> tuple[float, float]:
        """The share of new scenes in which the hand ends at what held-out words name, and the
        reward in each step. The policy sees objects from the hand's wrong frame."""
        act = greedy(policy, self.task.config)
        off = np.zeros(self.task.design.schema.width, np.float32)
        off[0] = self.options.off

        def acts(seen: Observation) -> Float64:
            return act(replace(seen, objects=seen.objects - off), self.task.program)

        condition = "eval" if self.task.design.held_out else "train"
        scores = list(run_episodes(self.task, acts, condition, scenes))
        share = np.mean([score.success for score in scores])
        return float(share), float(np.mean([score.reward_per_step for score in scores]))

    def run(self) -> dict[str, float]:
        arm, frames = self.arm, self.options.frames
        began = time.monotonic()
        arm.moved_at = 0.0  # the clock begins
        # Twice the arm's own time, and time to start.
        limit_s = frames * PERIOD_S * 2 + 600
        over = lambda: self.frames >= frames or self.ended()  # noqa: E731
        if not spin_until(arm, over, limit_s) or self.frames < frames:
            print(f"expected {frames} frames in {limit_s:g} s, got {self.frames}")
        wall_s = time.monotonic() - began
        self.score_kept()
        assert self.policy is not None
        needed, scatters = self.needed or (frames, arm.scenes - 1)
        share, reward = self.score(self.policy, self.options.scenes)
        before = self.first or (share, reward)
        return {
            "held_out_worst": share,
            "reward": reward,
            "held_out_before": before[0],
            "reward_before": before[1],
            "frames": needed,
            "minutes": needed * PERIOD_S / 60,
            "scatters": scatters,
            "outside_box_mm": 1e3 * max(arm.outside_m, 0.0),
            "above_speed": arm.too_fast,
            "fastest_joint": arm.fastest,
            "samples": arm.samples,
            "wall_s": wall_s,
        }
