"""A demonstration: a shipped agent executes programs; another learns, and executes them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import numpy as np

from pa_ros.acting.execution import HOLD_S, WINDOW_S
from pa_ros.arena import ReachTask, training_programs
from pa_ros.core.errors import PaError
from pa_ros.evaluation.scoring.evaluate import reference_scores
from pa_ros.evaluation.scoring.rewards import rewards
from pa_ros.evaluation.scoring.tally import HeldOutTarget
from pa_ros.language import Program
from pa_ros.tools.client import Node, client_node
from pa_ros.tools.demo.config import DemoConfig
from pa_ros.tools.demo.executor import Executor, hear_verdicts
from pa_ros.tools.demo.results import Outcome, conclude, execution_row, row, write_report
from pa_ros.tools.demo.scenes import (
    FEWER,
    FULL,
    DemoProgram,
    Scene,
    demo_programs,
    draw_learning_curve,
    draw_phi,
    find_scene,
)
from pa_ros.tools.graph import start_nodes, watch
from pa_ros.tools.launcher import Supervisor
from pa_ros.tools.monitor import Display, GraphFigures, watch_diagnostics
from pa_ros.tools.record import Recorder
from pa_ros.wire.services import ResetRequest

REFERENCE_EPISODES = 50

Interrupted = Callable[[], bool]


def demonstrate(config: DemoConfig, shipped_first: bool, interrupted: Interrupted) -> bool:
    """Execute, learn, execute; whether all went well. Leaves checkpoint, pictures, bags, demo.json.

    Raises PaError if nodes fail, KeyboardInterrupt if `interrupted`.
    """
    outcome, shipped = Outcome(), Outcome()
    if shipped_first:
        # A node of its own: its last program is latched, and would be executed by those that learn.
        with client_node("demo") as node:
            show_shipped(node, config.of_shipped(), shipped, interrupted)
    with client_node("demo") as node:
        _introduce(config)
        asked = _asked(config)
        target = _measure_target(config)
        _learn(node, config, target, outcome, interrupted)
        held_out, scene = asked[1]
        _draw(config, target, outcome, held_out, scene)
        if outcome.reached:
            print("Now what was learned is executed, as the shipped agent was.\n")
            execute_programs(node, config, asked, outcome, interrupted)
    write_report(config, target, outcome, shipped)
    conclude(config, target, outcome)
    return outcome.success and (shipped.executed or not shipped_first)


def _asked(config: DemoConfig) -> list[tuple[DemoProgram, Scene]]:
    """The programs, each with the scene that it is sent in."""
    return [
        (program, find_scene(config.arena, config.design, config.scene_seed, program))
        for program in demo_programs(config.design)
    ]


def show_shipped(
    node: Node, config: DemoConfig, outcome: Outcome, interrupted: Interrupted
) -> None:
    """First: what an agent that comes with the package does at once."""
    print(
        f"First, an agent that learned design {config.design.name} executes programs: sim_node (a\n"
        f"robot arm among blocks) and agent_node (moves the arm; weights {config.policy}).\n"
        f"Trained on: {_listed(training_programs(config.design))}\n"
    )
    execute_programs(node, config, _asked(config), outcome, interrupted)
    print(f"\n{outcome.satisfied} of {len(outcome.executions)} programs executed.\n")


def _listed(programs: Iterable[Program]) -> str:
    """Their targets alone, which are shorter."""
    return ", ".join(str(program.target) for program in programs)


def _introduce(config: DemoConfig) -> None:
    held_out = [kind.conjunction for kind in config.design.held_out]
    print(
        f"Now an agent learns design {config.design.name} from random weights: sim_node,\n"
        "agent_node and learner_node (learns from what happens), faster than real time.\n"
        f"Trained on:       {_listed(training_programs(config.design))}\n"
        f'Never trained on: {", ".join(held_out)} ("zero-shot")\n'
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
    return HeldOutTarget(random=random, scripted=scripted)


def _learn(
    node: Node,
    config: DemoConfig,
    target: HeldOutTarget,
    outcome: Outcome,
    interrupted: Interrupted,
) -> None:
    """The graph in lockstep until the target is reached or the time is up."""
    figures, started, tally = GraphFigures(), time.monotonic(), outcome.tally
    watch_diagnostics(node, figures)
    hear_verdicts(node, tally.observe)

    def elapsed_s() -> float:
        return time.monotonic() - started

    def rows() -> list[tuple[str, str]]:
        score, success = target.score(tally)
        return [
            ("elapsed", f"{elapsed_s() / 60:.1f} of at most {config.minutes:g} minutes"),
            ("zero-shot score", f"{score:.2f}; done at {target.normalized} (last "
             f"{target.episodes} episodes)"),
            ("zero-shot success", f"{success:.0%}; done at {target.success:.0%}"),
            *figures.rows(),
        ]  # fmt: skip

    def line() -> str:
        score, success = target.score(tally)
        return f"zero-shot score {score:.2f}  success {success:.0%}  {figures.line()}"

    folder = config.folder / "log" / "learn"
    with Supervisor(folder) as supervisor:
        start_nodes(supervisor, config.training(), folder)
        with Display("Learning (Ctrl-C stops everything)", rows, line) as display:
            watch(
                node,
                supervisor,
                display.refresh,
                lambda: interrupted() or target.reached(tally),
                config.minutes * 60,
            )
        outcome.reached, outcome.train_wall_s = target.reached(tally), elapsed_s()
        statuses = supervisor.stop()
    if interrupted():
        raise KeyboardInterrupt
    if statuses["learner_node"] != 0:
        raise PaError(f"learner_node did not stop cleanly: exit status {statuses['learner_node']}")
    verdict = "reached" if outcome.reached else "NOT reached"
    took = f"{outcome.train_wall_s:.0f} s and {tally.frames} control steps"
    print(f"\nTarget {verdict} after {took}.\n")


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


def execute_programs(
    node: Node,
    config: DemoConfig,
    asked: list[tuple[DemoProgram, Scene]],
    outcome: Outcome,
    interrupted: Interrupted,
) -> None:
    """Programs by topic, each in a scene of its own, recorded in a bag."""
    print(
        f"The arena runs in real time ({config.real_time_factor:g}x). Each program is sent on the\n"
        f"topic `program` and has {WINDOW_S:g} s; satisfied is to be near for {HOLD_S:g} s\n"
        "without a break, or at the end.\n"
    )
    figures = GraphFigures()
    watch_diagnostics(node, figures)
    with (
        Recorder(config.folder / "programs", node),
        Supervisor(config.folder / "log" / "execute") as supervisor,
    ):
        start_nodes(supervisor, config.execution(), config.folder / "log" / "execute")
        executor = Executor(node, supervisor, figures, interrupted, config.real_time_factor)
        executor.wait_until_ready()
        print(row("", "program", "from", "to", "satisfied", "reached after"))
        for program, scene in asked:
            request = ResetRequest(scene.episode.index, evaluation=scene.condition == FEWER)
            execution = executor.execute(program.text, request)
            outcome.executions.append((program, scene, execution))
            print(execution_row(program, scene, execution), flush=True)
