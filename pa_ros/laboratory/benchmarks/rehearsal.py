"""How often an agent reaches what a program names: in the arena, and on a robot that robot_node
drives through the standard topics alone (docs/robot.md)."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rclpy.action import ActionClient

from laboratory.benchmarks.written import WrittenMessages
from pa_ros.acting.execution import HOLD_S, WINDOW_S, ExecutionWatch
from pa_ros.agents import greedy
from pa_ros.arena import ReachTask, play, scoring_of
from pa_ros.arena.task import Verifier
from pa_ros.core.experience import Step
from pa_ros.core.extensions import load
from pa_ros.core.text import Report
from pa_ros.language import parse
from pa_ros.learning.checkpoints import load_policy
from pa_ros.ros import topics
from pa_ros.ros.actions import EXECUTE_PROGRAM
from pa_ros.ros.executor import release, spin_until
from pa_ros.tools.domain import use_free_domain
from pa_ros.wire.program import GoalResult, ProgramGoal, decode_goal_result, encode_goal

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
AGENT = "shipped:3-D"
PROGRAMS = (
    "NEAR(HAND, AND(RED, CUBE))",
    "NEAR(HAND, AND(GREEN, CUBE))",
    "NEAR(HAND, SPHERE)",
    "NEAR(HAND, BLUE)",
    "NEAR(HAND, AND(NOT(RED), CUBE))",
)
START_S, SETTLE_S, GOAL_S = 120.0, 3.0, 120.0  # wall time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--scenes", type=int, default=20, help="one program each (%(default)s)")
    parser.add_argument("--tags", action="store_true", help="a camera finds the objects' tags")
    parser.add_argument(
        "--no-relay", action="store_true", help="robot_node commands the arm itself"
    )


def run(options: argparse.Namespace) -> Report:
    """Shares of the programs that held for a second within ten, and the milliseconds from an
    agent's command to the arm's velocity."""
    use_free_domain()
    (simulated,) = load([str(EXAMPLES / "simulated_arm.py")])
    arena = [_in_the_arena(simulated, scene) for scene in range(options.scenes)]
    delays: list[float] = []
    relay = not options.no_relay
    robot = _on_the_robot(simulated, options.scenes, options.tags, relay, delays)
    for where, reached in (("arena", arena), ("robot", robot)):
        missed = [scene for scene, ok in enumerate(reached) if not ok]
        print(f"{where}: {sum(reached)} of {len(reached)}, missed scenes {missed}")
    p50, p99 = np.percentile(delays, (50, 99)).tolist()
    shares = {"arena": sum(arena) / len(arena), "robot": sum(robot) / len(robot)}
    return {**shares, "command_p50_ms": p50, "command_p99_ms": p99}


def _in_the_arena(simulated: Any, scene: int) -> bool:
    """Whether a program is executed in a scene of the arena, in lockstep."""
    task = ReachTask(simulated.CONFIG, simulated.DESIGN, seed=0)
    program = parse(_program(scene), simulated.DESIGN.vocabulary)
    start = task.reset_to(replace(simulated.scene_of(scene), goal=program))
    act = greedy(load_policy(Path(AGENT)), simulated.CONFIG)
    watch = ExecutionWatch(task.program_id)
    for seen, verdict in play(task, lambda seen: act(seen, program), start):
        if (done := watch.observe(Step(seen, verdict, str(program)))) is not None:
            break
    return done is not None and done.satisfied


def _on_the_robot(
    simulated: Any, scenes: int, tags: bool, relay: bool, delays: list[float]
) -> list[bool]:
    """Whether programs are executed by an agent and a robot_node, each in a process of its own.

    :param delays: receives the milliseconds from each command to the velocity that follows it.
    """
    import rclpy

    from pa_ros.ros.environment import prepare_environment

    prepare_environment()
    python, started = sys.executable, []
    with tempfile.TemporaryDirectory() as folder:
        described = yaml.safe_load((EXAMPLES / "robot.yaml").read_text())
        described |= {"dry_run": False, "relay": relay}
        if not tags:
            for name, thing in described["objects"].items():
                described["objects"][name] = {"words": thing["words"], "frame": name}
        file = Path(folder) / "robot.yaml"
        file.write_text(yaml.safe_dump(described, sort_keys=False))
        robot = ["sim_node.robot.main", "--ros-args", "-p", f"robot:={file}"]
        agent = ["agent_node.main", "--ros-args", "-p", "weights:=checkpoint"]
        commands = [
            ["-m", *robot, "-p", "autostart:=true"],
            ["-m", *agent, "-p", f"checkpoint:={AGENT}"],
            *([[str(EXAMPLES / "tag_tracker.py")]] if tags else []),
        ]
        rclpy.init(args=["--ros-args", "-p", f"tags:={str(tags).lower()}"])
        arm = simulated.ArmDriver()
        written = _listen(arm, delays)
        try:
            started = [subprocess.Popen([python, "-P", *command]) for command in commands]
            return _execute(simulated, arm, scenes)
        finally:
            for process in started:
                process.terminate()
            for process in started:
                process.wait()
            written.close()
            arm.close()
            release(arm)
            arm.destroy_node()
            rclpy.shutdown()


def _listen(arm: Any, delays: list[float]) -> WrittenMessages:
    """Note the milliseconds from the writing of each command to that of the next velocity."""
    commanded: list[float] = []

    def process(topic: int, _message: Any, written_s: float) -> None:
        if topic == 0:
            commanded[:] = [written_s]
        elif commanded and written_s >= commanded[0]:
            delays.append((written_s - commanded.pop()) * 1e3)

    return WrittenMessages(arm, (topics.JOINT_COMMANDS, topics.VELOCITY_COMMANDS), process)


def _execute(simulated: Any, arm: Any, scenes: int) -> list[bool]:
    """Send each scene's program as a goal; whether the goal succeeded, and the hand truly was near:
    the robot's own verdict is only as good as its measurements."""
    client, reached = ActionClient(arm, EXECUTE_PROGRAM[1], EXECUTE_PROGRAM[0]), []
    scoring = scoring_of(simulated.CONFIG, simulated.DESIGN)
    if not spin_until(arm, client.server_is_ready, START_S):
        raise SystemExit(f"expected an agent within {START_S:g} s, got none")
    for scene in range(scenes):
        arm.place(scene)
        spin_until(arm, lambda: False, SETTLE_S)  # until the new scene is measured
        started = time.monotonic()
        goal = ProgramGoal(_program(scene), WINDOW_S, HOLD_S)
        result = result_of(arm, client, goal)
        took = time.monotonic() - started
        named = Verifier(
            parse(goal.text, simulated.DESIGN.vocabulary), simulated.KINDS, scoring
        ).named
        hand, *objects = (
            arm.arm.body(name).position for name in ("hand", *simulated.OBJECTS.values())
        )
        away = min(float(np.linalg.norm(objects[i - 1] - hand)) for i in named)
        reached.append(result.success and away <= scoring.threshold("NEAR"))
        told = "" if result.success else result.reason
        print(f"scene {scene}: {goal.text}: {reached[-1]}, {took:.1f} s, {away:.3f} m {told}")
    client.destroy()
    return reached


def result_of(arm: Any, client: Any, goal: ProgramGoal) -> GoalResult:
    """The result of a goal; an agent that knows no arena yet is asked again."""
    until = time.monotonic() + GOAL_S
    while True:
        sent = client.send_goal_async(encode_goal(goal))
        spin_until(arm, sent.done, GOAL_S)
        ended = sent.result().get_result_async()
        spin_until(arm, ended.done, GOAL_S)
        result = decode_goal_result(ended.result().result)
        if result.code != "goal.unready" or time.monotonic() > until:
            return result
        spin_until(arm, lambda: False, SETTLE_S)


def _program(scene: int) -> str:
    return PROGRAMS[scene % len(PROGRAMS)]
