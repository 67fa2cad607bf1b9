"""`pa_ros launch`: the nodes of a parameters file as processes, and one live table."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path
from typing import get_args

from pa_ros.acting.config import Schedule
from pa_ros.arena import ArenaChoice
from pa_ros.bags.writer import refuse_existing
from pa_ros.cli.console import page_beside
from pa_ros.cli.options import add_setting, folder_to_write
from pa_ros.core.signals import signals_noted
from pa_ros.learning.config import TrainConfig
from pa_ros.perception import VIEWS
from pa_ros.tools.client import client_node
from pa_ros.tools.graph import refuse_running, start_nodes, watch
from pa_ros.tools.launch_params import (
    NODES,
    arenas_of,
    chosen,
    extended,
    fleet,
    in_step,
    learning_into,
    load_parameters,
    new_folder,
    packaged_names,
    preferred,
    seeing,
)
from pa_ros.tools.launcher import ChildError, Supervisor, status_text, tail
from pa_ros.tools.monitor import Display, GraphFigures, watch_diagnostics
from pa_ros.tools.record_launch import start_recorded, start_recorder
from pa_ros.tools.scenes import SceneFigures

DEFAULT = "execute_3d"
EXIT_FAILED = 1
IN_ORDER = (0, -signal.SIGINT, -signal.SIGTERM)  # these two: before a child could handle them


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros launch`."""
    parser.add_argument(
        "--params", default=DEFAULT, metavar="FILE",
        help="ROS parameters; each node that it names is started. Or one that is packaged: "
        f"{', '.join(packaged_names())} (default: execute programs with the shipped 3-D agent)",
    )  # fmt: skip
    parser.add_argument(
        "--checkpoint", metavar="DIR", help="let this agent act, in an arena like that of its "
        "training: the folder of a run, or shipped:NAME (default: the file's)",
    )  # fmt: skip
    add_setting(parser, ArenaChoice, "design", otherwise="the file's, or the checkpoint's")
    add_setting(parser, TrainConfig, "seed", otherwise="the file's")
    parser.add_argument(
        "--perception", choices=VIEWS,
        help="let the arena see its blocks through cameras. Agents that learn get a new one, above "
        "the table (camera), in a corner, or both; an agent of a checkpoint uses its own, and "
        "shipped:camera takes the place of shipped:3-D",
    )  # fmt: skip
    parser.add_argument("--namespace", default="", help="for all nodes (default: none)")
    parser.add_argument(
        "--arenas", type=int, metavar="N",
        help="start N copies of the file's arena and agent, in namespaces arena1, arena2 …, each "
        "with its own seed, and one learner for all",
    )  # fmt: skip
    parser.add_argument(
        "--in-step", choices=get_args(Schedule.model_fields["in_step"].annotation),
        help="learner.schedule.in_step: whether agents and learner wait for each other "
        "(default: as in the file)",
    )  # fmt: skip
    parser.add_argument(
        "--compose", action="store_true",
        help="run each arena and its agent in one process: about twice as many steps per second",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=folder_to_write, metavar="DIR",
        help="folder of parameters and logs, and of checkpoints if the file names none "
        "(default: a new runs/launch-<time>)",
    )  # fmt: skip
    parser.add_argument(
        "--record", type=folder_to_write, metavar="BAG", help="record the graph into a bag"
    )
    parser.add_argument(
        "--console", action="store_true",
        help="serve the page of `pa_ros console` on a free port",
    )  # fmt: skip
    parser.epilog = "Ctrl-C stops all nodes; exit status 1 if one failed or ended by itself"


def run(options: argparse.Namespace) -> int:
    """Launch, and show figures until a signal comes or a node ends by itself."""
    if options.record is not None:
        refuse_existing(options.record)
    wanted = load_parameters(chosen(options.params))
    wanted = preferred(wanted, options.checkpoint, options.design, options.seed)
    if options.perception is not None:
        wanted = seeing(wanted, options.perception)
    if options.arenas is not None:
        wanted = fleet(wanted, options.arenas)
    if options.in_step is not None:
        wanted = in_step(wanted, options.in_step)
    wanted = extended(wanted, options.extension)
    folder = options.out or new_folder("launch")
    parameters = learning_into(folder, wanted)
    figures = GraphFigures()
    with signals_noted() as interrupted, client_node("launcher", options.namespace) as node:
        refuse_running(node, parameters)
        watch_diagnostics(node, figures)
        with page_beside(node, options), Supervisor(folder / "log") as supervisor:
            try:
                if options.record is None:
                    start_nodes(supervisor, parameters, folder, options.namespace, options.compose)
                else:
                    arenas = arenas_of(parameters)
                    start_recorder(supervisor, node, options.record, options.namespace, arenas)
                    start_recorded(supervisor, node, parameters, folder, options.compose)
                print(f"started {', '.join(supervisor.names)}; logs in {folder / 'log'}")
                tables = SceneFigures(node, figures, arenas_of(parameters))
                with Display("Graph (Ctrl-C stops it)", tables.rows, tables.line) as display:
                    watch(node, supervisor, display.refresh, interrupted)
            except ChildError as error:
                print(f"pa_ros launch: {error}", file=sys.stderr)
                stop(supervisor, folder / "log")
                return EXIT_FAILED
            print("stopping")
            return stop(supervisor, folder / "log")


def stop(supervisor: Supervisor, logs: Path) -> int:
    """Stop all nodes, print those that failed, and return the exit status.

    Agents end first, so that their arms rest; then the learner, which has received everything they
    sent; then the arenas, and the rest last.
    """
    statuses: dict[str, int] = {}
    for kind in (*reversed(NODES), ""):
        if named := [name for name in supervisor.names if name.endswith(kind)]:
            statuses |= supervisor.stop(named)
            print(f"stopped {', '.join(named)}")
    failed = {name: status for name, status in statuses.items() if status not in IN_ORDER}
    for name, status in failed.items():
        log = logs / f"{name}.log"
        print(f"pa_ros launch: {name} failed ({status_text(status)}); the last lines of {log}:\n"
              f"{tail(log)}", file=sys.stderr)  # fmt: skip
    return EXIT_FAILED if failed else 0
