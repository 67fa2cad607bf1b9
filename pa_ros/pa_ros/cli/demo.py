"""`pa_ros demo` (`make run`): a graph learns from scratch, then executes what was never trained."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.arena import ArenaConfig, Design, ReachTask, design_named, preset_named
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.core.report import device, versions
from pa_ros.evaluation.demo_report import (
    FEWER,
    FULL,
    DemoProgram,
    Scene,
    demo_programs,
    draw_learning_curve,
    draw_phi,
    find_scene,
)
from pa_ros.evaluation.evaluate import reference_scores
from pa_ros.evaluation.scores import rewards
from pa_ros.evaluation.tally import EpisodeTally, HeldOutTarget
from pa_ros.evaluation.training import training_programs
from pa_ros.ros.client import Node, client_node
from pa_ros.ros.demonstration import Executor, hear_verdicts
from pa_ros.ros.execution import HOLD_S, WINDOW_S, Execution
from pa_ros.ros.graph import signals_noted, start_nodes, use_domain, watch
from pa_ros.ros.launch_params import Parameters, load_parameters, merged, packaged
from pa_ros.ros.launcher import Supervisor
from pa_ros.ros.monitor import Display, GraphFigures, watch_diagnostics
from pa_ros.ros.record import Recorder
from pa_ros.wire.records import ResetRequest

EXIT_FAILED, EXIT_INTERRUPTED = 1, 130
REFERENCE_EPISODES = 50
SCENE_SEED_OFFSET = 1_000_000  # scenes to execute in are none of those trained in
REAL_TIME_FACTOR = 2.0  # of the execution
NEEDED = 5  # programs of the six, the held-out one among them

Interrupted = Callable[[], bool]


@dataclass(frozen=True)
class DemoConfig:
    """One demonstration."""

    design: Design
    arena: ArenaConfig
    seed: int
    minutes: float
    folder: Path

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"demo --seed: expected at least 0, got {self.seed}")
        if not 0 < self.minutes < float("inf"):
            raise ConfigError(f"demo --minutes: expected a positive number, got {self.minutes}")
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise ConfigError(f"demo --out: expected a new or empty folder, got {self.folder}")

    @property
    def checkpoint(self) -> Path:
        """Where the learner leaves what it learned."""
        return self.folder / "checkpoint"

    def training(self) -> Parameters:
        """Parameters of the three nodes that learn."""
        arena = {"design": self.design.name, "preset": self.arena.preset, "seed": self.seed}
        changes: dict[str, dict[str, Any]] = {
            "sim_node": arena,
            "agent_node": {"seed": self.seed},
            "learner_node": {"seed": self.seed, "out": str(self.folder.resolve())},
        }
        return merged(load_parameters(packaged("train_2l")), changes)

    def execution(self) -> Parameters:
        """Parameters of the two nodes that execute."""
        arena = {
            "design": self.design.name,
            "preset": self.arena.preset,
            "seed": self.seed + SCENE_SEED_OFFSET,
            "condition": FULL,
            "eval_condition": FEWER,
            "real_time_factor": REAL_TIME_FACTOR,
        }
        weights = {"checkpoint": str(self.checkpoint.resolve())}
        changes: dict[str, dict[str, Any]] = {"sim_node": arena, "agent_node": weights}
        return merged(load_parameters(packaged("execute_2l")), changes)


@dataclass
class Outcome:
    """What a demonstration found; becomes demo.json."""

    tally: EpisodeTally = field(default_factory=EpisodeTally)
    train_wall_s: float = 0.0
    reached: bool = False
    executions: list[tuple[DemoProgram, Scene, Execution]] = field(default_factory=list)

    @property
    def satisfied(self) -> int:
        """How many of the programs were executed."""
        return sum(execution.satisfied for _, _, execution in self.executions)

    @property
    def success(self) -> bool:
        """The held-out program and at least NEEDED of the six were satisfied."""
        held_out = any(e.satisfied for p, _, e in self.executions if p.kind == "held out")
        return self.reached and held_out and self.satisfied >= NEEDED


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros demo`."""
    parser.add_argument("--design", default="2-L", help="2-L or 3-D (%(default)s)")
    parser.add_argument("--preset", default="fast", help="arena: fast or paper (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="(%(default)s)")
    parser.add_argument(
        "--minutes", type=float, default=20.0, help="give up learning after these (%(default)s)"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="(default: runs/demo-<time>)")
    parser.add_argument(
        "--domain-id", type=int, metavar="N", help="ROS domain (default: an unused one)"
    )
    parser.epilog = (
        "exit status: 0 if the held-out program and at least five of the six were executed, "
        "1 if not, 130 if interrupted"
    )


def run(options: argparse.Namespace) -> int:
    """Learn, execute, leave checkpoint, pictures, bag and demo.json."""
    folder = options.out or Path("runs") / f"demo-{time.strftime('%Y%m%d-%H%M%S')}"
    design, arena = design_named(options.design), preset_named(options.preset)
    config = DemoConfig(design, arena, options.seed, options.minutes, folder)
    programs = demo_programs(design)
    domain_id = use_domain(options.domain_id)
    outcome = Outcome()
    with signals_noted() as interrupted:
        try:
            return _run(config, programs, outcome, domain_id, interrupted)
        except KeyboardInterrupt:
            print("interrupted; every process was stopped")
            return EXIT_INTERRUPTED
        except PaError as error:
            print(f"pa_ros demo: {error}", file=sys.stderr)
            return EXIT_FAILED


def _run(
    config: DemoConfig,
    programs: list[DemoProgram],
    outcome: Outcome,
    domain_id: int,
    interrupted: Interrupted,
) -> int:
    _introduce(config, domain_id)
    scenes = [
        find_scene(config.arena, config.design, config.seed + SCENE_SEED_OFFSET, program)
        for program in programs
    ]
    target = _measure_target(config)
    with client_node("demo") as node:
        _learn(node, config, target, outcome, interrupted)
        _draw(config, target, outcome, programs[1], scenes[1])
        if outcome.reached:
            _execute(node, config, list(zip(programs, scenes, strict=True)), outcome, interrupted)
    _write_report(config, target, outcome)
    _conclude(config, target, outcome)
    return 0 if outcome.success else EXIT_FAILED


def _introduce(config: DemoConfig, domain_id: int) -> None:
    held_out = [f"NEAR(HAND, AND({kind.color}, {kind.shape}))" for kind in config.design.held_out]
    print(
        "Three ROS 2 processes start from random weights: sim_node (a robot arm among blocks),\n"
        "agent_node (moves the arm) and learner_node (learns from what happens).\n"
        f"They learn these programs: {', '.join(training_programs(config.design))}\n"
        f"and are never trained on:  {', '.join(held_out)} (\"zero-shot\")\n"
        f"ROS domain {domain_id}; everything is left in {config.folder}/\n"
    )


def _measure_target(config: DemoConfig) -> HeldOutTarget:
    """Both references on the episodes that the graph will be evaluated on first."""
    task = ReachTask(config.arena, config.design, config.seed)
    random, scripted = (
        float(np.mean(rewards(reference_scores(task, name, FULL, REFERENCE_EPISODES))))
        for name in ("random", "scripted")
    )
    print(
        "Zero-shot reward per step is +1 where the hand is near the right block, else -1.\n"
        f"On those episodes random motion gets {random:+.2f} (score 0), a script that knows the\n"
        f"answer {scripted:+.2f} (score 1).\n"
    )
    return HeldOutTarget(random, scripted)


def _learn(
    node: Node,
    config: DemoConfig,
    target: HeldOutTarget,
    outcome: Outcome,
    interrupted: Interrupted,
) -> None:
    """First phase: the graph in lockstep until the target is reached or the time is up."""
    figures, started, tally = GraphFigures(), time.monotonic(), outcome.tally
    watch_diagnostics(node, figures)
    hear_verdicts(node, tally.observe)

    def rows() -> list[tuple[str, str]]:
        score, success = target.score(tally)
        elapsed = time.monotonic() - started
        return [
            ("elapsed", f"{elapsed / 60:.1f} of at most {config.minutes:g} minutes"),
            ("zero-shot score", f"{score:.2f}; done at {target.normalized} (last "
             f"{target.episodes} episodes)"),
            ("zero-shot success", f"{success:.0%}; done at {target.success:.0%}"),
            *figures.rows(),
        ]  # fmt: skip

    def line() -> str:
        score, success = target.score(tally)
        return f"zero-shot score {score:.2f}  success {success:.0%}  {figures.line()}"

    with Supervisor(config.folder / "log" / "learn") as supervisor:
        start_nodes(supervisor, config.training(), config.folder / "log" / "learn")
        with Display("Learning (Ctrl-C stops everything)", rows, line) as display:
            watch(
                node,
                supervisor,
                display.refresh,
                lambda: interrupted() or target.reached(tally),
                config.minutes * 60,
            )
        outcome.reached = target.reached(tally)
        outcome.train_wall_s = time.monotonic() - started
        statuses = supervisor.stop()
    if interrupted():
        raise KeyboardInterrupt
    if statuses["learner_node"] != 0:
        raise PaError(f"learner_node did not stop cleanly: exit status {statuses['learner_node']}")
    verdict = "reached" if outcome.reached else "NOT reached, time is up"
    print(
        f"\nTarget {verdict} after {outcome.train_wall_s:.0f} s and {tally.frames} control steps.\n"
    )


def _draw(
    config: DemoConfig,
    target: HeldOutTarget,
    outcome: Outcome,
    program: DemoProgram,
    scene: Scene,
) -> None:
    title = f"design {config.design.name}, seed {config.seed}, over the graph"
    if outcome.tally.episodes:
        curve = config.folder / "learning-curve.png"
        draw_learning_curve(curve, outcome.tally, target, title)
    phi = config.folder / "phi.png"
    draw_phi(phi, config.checkpoint, config.arena, config.design, scene, program.text)


def _execute(
    node: Node,
    config: DemoConfig,
    asked: list[tuple[DemoProgram, Scene]],
    outcome: Outcome,
    interrupted: Interrupted,
) -> None:
    """Second phase: programs by topic, each in a scene of its own, recorded in a bag."""
    print(
        f"Now the arena runs in real time ({REAL_TIME_FACTOR:g}x) and the agent acts on what it\n"
        f"learned. Each program is sent on the topic `program` and has {WINDOW_S:g} s; satisfied\n"
        f"is to be near for {HOLD_S:g} s without a break, or at the end.\n"
    )
    figures = GraphFigures()
    watch_diagnostics(node, figures)
    with (
        Recorder(config.folder / "programs", node),
        Supervisor(config.folder / "log" / "execute") as supervisor,
    ):
        start_nodes(supervisor, config.execution(), config.folder / "log" / "execute")
        executor = Executor(node, supervisor, figures, interrupted, REAL_TIME_FACTOR)
        executor.wait_until_ready()
        print(_row("", "program", "from", "to", "satisfied", "reached after"))
        for program, scene in asked:
            request = ResetRequest(scene.episode.index, evaluation=scene.condition == FEWER)
            execution = executor.execute(program.text, request)
            outcome.executions.append((program, scene, execution))
            print(_execution_row(program, scene, execution), flush=True)


def _execution_row(program: DemoProgram, scene: Scene, execution: Execution) -> str:
    after = "" if execution.reached_s is None else f"{execution.reached_s:.1f} s"
    satisfied = "yes" if execution.satisfied else "NO"
    distances = f"{scene.distance:.2f} m", f"{execution.distance:.2f} m"
    return _row(program.kind, program.text, *distances, satisfied, after)


def _row(*cells: str) -> str:
    widths = (12, 56, 7, 7, 10, 13)
    return " ".join(f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def _write_report(config: DemoConfig, target: HeldOutTarget, outcome: Outcome) -> None:
    score, success = target.score(outcome.tally)
    report: dict[str, float | int | str] = {
        "demo.design": config.design.name,
        "demo.preset": config.arena.preset,
        "demo.seed": config.seed,
        "demo.reached": int(outcome.reached),
        "demo.train_wall_s": outcome.train_wall_s,
        "demo.frames": outcome.tally.frames,
        "demo.held_out_normalized": score,
        "demo.held_out_success_rate": success,
        "demo.random_reward_per_step": target.random,
        "demo.scripted_reward_per_step": target.scripted,
        "demo.programs": len(outcome.executions),
        "demo.satisfied": outcome.satisfied,
        "demo.success": int(outcome.success),
    }
    for program, scene, execution in outcome.executions:
        name = f"demo.{program.kind.lower().replace(' ', '_')}"
        report |= {
            f"{name}.program": program.text,
            f"{name}.satisfied": int(execution.satisfied),
            f"{name}.distance_from_m": scene.distance,
            f"{name}.distance_to_m": execution.distance,
        }
        if execution.reached_s is not None:
            report[f"{name}.reached_s"] = execution.reached_s
    report |= {"device": device(), "threads": 1, "versions": versions()}
    finite = {k: v for k, v in report.items() if not isinstance(v, float) or np.isfinite(v)}
    (config.folder / "demo.json").write_text(json.dumps(finite, indent=2) + "\n")


def _conclude(config: DemoConfig, target: HeldOutTarget, outcome: Outcome) -> None:
    if outcome.executions:
        print(f"\n{outcome.satisfied} of {len(outcome.executions)} programs executed.")
    else:
        score, success = target.score(outcome.tally)
        print(
            f"No success within {config.minutes:g} minutes: zero-shot score {score:.2f} of "
            f"{target.normalized}, success {success:.0%} of {target.success:.0%}."
        )
    print(f"Left in {config.folder}/:")
    for name, what in (
        ("checkpoint/", "what was learned"),
        ("learning-curve.png", "reward per step, trained and zero-shot"),
        ("phi.png", "what the learned detectors see in one scene"),
        ("programs/", "the execution as an MCAP bag"),
        ("demo.json", "these figures"),
        ("log/", "what each process wrote, and its parameters"),
    ):
        if (config.folder / name).exists():
            print(f"  {name:<20} {what}")
