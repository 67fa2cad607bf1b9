"""`pa_ros demo` (`make run`): a shipped agent executes programs; another learns to; a third one
moves blocks."""

from __future__ import annotations

import argparse
import os
import secrets
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.acting.execution import HOLD_S, WINDOW_S
from pa_ros.agents import load_agent
from pa_ros.arena import Design, ReachTask, design_named, preset_for, training_programs
from pa_ros.cli.options import add_setting, folder_to_write
from pa_ros.console.settings import TOKEN, control_address, free_port
from pa_ros.core.errors import ConfigError, PaError
from pa_ros.evaluation.drawing import draw_detectors
from pa_ros.evaluation.evaluate import reference_scores
from pa_ros.evaluation.scores import rewards
from pa_ros.evaluation.tally import EpisodeTally, HeldOutTarget
from pa_ros.learning.checkpoint_files import SHIPPED_PREFIX
from pa_ros.learning.config import TrainConfig
from pa_ros.learning.folder import checkpoint_of
from pa_ros.ros.topics import OBJECT_FEATURES
from pa_ros.tools.arm import Arm
from pa_ros.tools.client import client_node
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.film import demo_programs, find_scene
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launch_params import load_parameters, merged, packaged
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import Display, GraphFigures, watch_diagnostics
from pa_ros.wire.step import decode_step
from pa_ros.world.relation import measured

SHIPPED, LEARNED = "3-D", "2-L"  # designs
MOVES = {  # shipped agents that move blocks: the kinds of programs to show, and what it says
    "push": (
        ("trained", "held out", "to a block", "color alone"),
        "Another agent of the package moves blocks: to places, which are colored disks, and to\n"
        "other blocks. It was never trained to move one to another block.",
    ),
    "stack": (
        ("trained", "held out", "to a block", "tower"),
        "The last agent has a vacuum cup. It puts blocks on places and on other blocks, and\n"
        "builds a tower, which it was never trained to do.",
    ),
}
SCENE_SEED = 1_000_000  # added to the seed: no scene of the executions was trained in
SPEED = 2.0  # times real time, during executions
REFERENCE_EPISODES = 50
ROW = "{:<12} {:<56} {:<{width}} {:<{width}} {:<10} {}"
EXIT_FAILED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros demo`."""
    add_setting(parser, TrainConfig, "seed")
    parser.add_argument(
        "--minutes", type=float, default=20.0, help="stop learning after these (%(default)g)"
    )
    parser.add_argument(
        "--no-shipped", dest="shipped", action="store_false", help="start with learning"
    )
    parser.add_argument(
        "--no-console", dest="console", action="store_false",
        help="do not serve the page of `pa_ros console`",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=folder_to_write, metavar="DIR",
        help="a new or empty folder for all results (runs/demo-<time>)",
    )  # fmt: skip
    parser.epilog = (
        "exit status: 0 if each agent executed the held-out program and all others but one, "
        "1 if not, 130 if interrupted"
    )


def run(options: argparse.Namespace) -> int:
    """Execute, learn, execute, move blocks. Results are left in one folder; Ctrl-C stops all."""
    folder = options.out or Path("runs") / f"demo-{time.strftime('%Y%m%d-%H%M%S')}"
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"--out: expected a new or empty folder, got {folder}")
    print(f"ROS domain {use_free_domain()}; results: {folder}/\n")
    try:
        with _page(options.console, folder):
            good = not options.shipped or _show_shipped(folder, options.seed)
            reached = _learn(folder, options.seed, options.minutes)
            good = reached and _execute_learned(folder, options.seed) and good
            if options.shipped:
                for name in MOVES:
                    good = _show_moving(name, folder, options.seed) and good
    except PaError as error:
        print(f"pa_ros demo: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("Interrupted. All processes were stopped.")
        raise
    finally:
        print(f"Results are in {folder}/.")
    return 0 if good else EXIT_FAILED


def _show_shipped(folder: Path, seed: int) -> bool:
    design = design_named(SHIPPED)
    print(f"First, an agent that comes with the package (design {SHIPPED}) executes programs.")
    print(f"It was trained on {_targets(design)}.\n")
    return execute(folder / "shipped", design, f"shipped:{SHIPPED}", seed + SCENE_SEED)


def _execute_learned(folder: Path, seed: int) -> bool:
    print("\nThe agent that has just learned executes programs.\n")
    checkpoint = str(checkpoint_of(folder).resolve())
    return execute(folder, design_named(LEARNED), checkpoint, seed + SCENE_SEED)


def _show_moving(name: str, folder: Path, seed: int) -> bool:
    kinds, said = MOVES[name]
    print(f"\n{said}\n")
    checkpoint = f"{SHIPPED_PREFIX}{name}"
    design = load_agent(checkpoint).design
    return execute(folder / name, design, checkpoint, seed + SCENE_SEED, kinds=kinds)


def execute(
    folder: Path,
    design: Design,
    checkpoint: str,
    seed: int,
    speed: float = SPEED,
    kinds: Sequence[str] = (),
) -> bool:
    """Send programs to an arena and an agent, one scene each; whether all but one were executed,
    and the held-out one.

    `kinds` chooses some of the six `demo_programs`. Prints a table. Records the graph into
    `folder`/programs.
    """
    programs = [one for one in demo_programs(design) if not kinds or one.kind in kinds]
    full, fewer = design.skill.demo_conditions
    config = preset_for(design)
    arena = {"design": design.name, "condition": full, "eval_condition": fewer}
    executed: list[str] = []
    with Arm.simulated(
        checkpoint, seed=seed, speed=speed, record=folder / "programs",
        logs=folder / "log" / "execute", domain=int(os.environ["ROS_DOMAIN_ID"]), **arena,
    ) as arm:  # fmt: skip
        print(f"Each program has {WINDOW_S:g} s. Satisfied: {HOLD_S:g} s near the target.\n")
        width = max(7, len(measured(programs[0].text, 10.0)))
        print(ROW.format("", "program", "from", "to", "satisfied", "after", width=width))
        for program in programs:
            scene = find_scene(config, design, seed, program)
            arm.reset(scene.episode.index, evaluation=scene.condition == fewer)
            found = arm.execute(program.text)
            executed += [program.kind] if found.success else []
            after = found.reason if found.reached_s is None else f"{found.reached_s:.1f} s"
            cells = (measured(program.text, away) for away in (scene.distance, found.distance))
            verdict = "yes" if found.success else "NO"
            row = program.kind, program.text, *cells, verdict, after
            print(ROW.format(*row, width=width), flush=True)
    print(f"\n{len(executed)} of {len(programs)} programs executed.")
    return "held out" in executed and len(executed) >= len(programs) - 1


def _learn(folder: Path, seed: int, minutes: float) -> bool:
    """Learn from random weights until the zero-shot target is reached; whether it was.

    Leaves the checkpoint and a picture of the detectors.
    """
    design = design_named(LEARNED)
    held_out = ", ".join(kind.conjunction for kind in design.held_out)
    print(f"\nAn agent learns design {LEARNED} from random weights, faster than real time.")
    print(f"It is trained on {_targets(design)};\nnever on {held_out} (zero-shot).")
    task = ReachTask(preset_for(design), design, seed)
    random, script = (
        float(np.mean(rewards(reference_scores(task, name, "eval", REFERENCE_EPISODES))))
        for name in ("random", "scripted")
    )
    print(f"Score 0 is random motion ({random:+.2f} per step), 1 is a script ({script:+.2f}).\n")
    changes: dict[str, dict[str, Any]] = {
        "sim_node": {"design": LEARNED, "seed": seed},
        "agent_node": {"seed": seed},
        "learner_node": {"seed": seed, "out": str(folder.resolve())},
    }
    parameters = merged(load_parameters(packaged("train_2l")), changes)
    target = HeldOutTarget(random=random, scripted=script)
    tally, figures = EpisodeTally(), GraphFigures()
    started, log = time.monotonic(), folder / "log" / "learn"
    with client_node("demo") as node, Supervisor(log) as supervisor:
        watch_diagnostics(node, figures)
        OBJECT_FEATURES.subscribe(node, lambda m: tally.observe(decode_step(m)))
        start_nodes(supervisor, parameters, log)

        def rows() -> list[tuple[str, str]]:
            score, success = target.score(tally)
            return [("zero-shot score", f"{score:.2f} (done at {target.normalized})"),
                    ("zero-shot success", f"{success:.0%} (done at {target.success:.0%})"),
                    *figures.rows()]  # fmt: skip

        def line() -> str:
            return f"zero-shot score {target.score(tally)[0]:.2f}  {figures.line()}"

        with Display("Learning (Ctrl-C stops everything)", rows, line) as display:
            reached = watch(
                node, supervisor, display.refresh, lambda: target.reached(tally),
                60.0 * minutes,
            )  # fmt: skip
        supervisor.stop()
    took = f"{time.monotonic() - started:.0f} s and {tally.frames} control steps"
    verdict = "reached" if reached else "NOT reached"
    print(f"\nZero-shot score {target.score(tally)[0]:.2f}: target {verdict} after {took}.")
    program = demo_programs(design)[1]
    scene = find_scene(task.config, design, seed + SCENE_SEED, program)
    seen, _ = task.reset_to(scene.episode)
    explanation = load_agent(folder).explain(seen, program.text)
    draw_detectors(folder / "detectors.png", task, explanation, program.text)
    return reached


def _targets(design: Design) -> str:
    return ", ".join(str(program.target) for program in training_programs(design))


@contextmanager
def _page(wanted: bool, folder: Path) -> Iterator[None]:
    """A console in another process, if it is wanted and installed; prints its address."""
    if wanted and all(find_spec(name) for name in ("viser", "mjviser")):
        port, token = free_port(), secrets.token_urlsafe(16)
        # The token is no argument: every user of this machine can read commands.
        with Supervisor(folder / "log", {TOKEN: token}) as supervisor:
            command = [sys.executable, "-m", "pa_ros", "console", "--port", f"{port}"]
            supervisor.start("console", command)
            print(f"Page in the browser: {control_address(port, token)}\n", flush=True)
            yield
        return
    if wanted:
        print("No page in the browser: it needs `make install-console`.\n")
    yield
