"""Run one benchmark: `make bench NAME=learner ARGS="--json learner.json"`."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from pathlib import Path

# One thread each, also for what torch and MuJoCo read from here when they are imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")

from pa_ros.core.errors import PaError
from pa_ros.core.signals import EXIT_INTERRUPTED, Interrupted, signals_interrupt
from pa_ros.core.software import device, versions
from pa_ros.core.text import write_report

# name: help. The module `benchmarks.NAME` defines add_arguments(parser) and run(options).
BENCHMARKS = {
    "arena": "control steps per second; scores of the script and of random actions",
    "baselines": "other networks and algorithms with our relabeling",
    "camera": "time from a picture to the command that it led to, on one core",
    "fetch": "pushing and lifting in Gymnasium-Robotics, beside hindsight of Stable-Baselines3",
    "fleet": "how much sooner several slow arenas bring one learner to its goal",
    "graph": "control steps per second of an arena and an agent as two processes",
    "latency": "time from a program, and from an observation, to the command",
    "learner": "updates per second, beside other implementations and a lower bound",
    "networks_alone": "how often networks execute programs without the rules of executing",
    "on_the_arm": "learning on a robot of robot_node, without resets: minutes and scatters",
    "peers": "agents of other libraries on the same task",
    "rehearsal": "how often programs are executed in the arena and on a robot of robot_node",
    "stacking": "how often towers are built with a robot of robot_node that has a gripper",
    "train": "updates per second while learning, as a share of updates alone",
}


def main() -> int:
    """Measure, print, and write the figures to --json."""
    parser = argparse.ArgumentParser(prog="python -m laboratory", description=__doc__)
    commands = parser.add_subparsers(dest="name", required=True, metavar="NAME")
    for name, summary in BENCHMARKS.items():
        command = commands.add_parser(name, help=summary, description=summary)
        command.add_argument("--json", type=Path, help="also write the figures to this file")
        if name in sys.argv:
            importlib.import_module(f"laboratory.benchmarks.{name}").add_arguments(command)
    options = parser.parse_args()
    try:
        with signals_interrupt():
            report = importlib.import_module(f"laboratory.benchmarks.{options.name}").run(options)
    except PaError as error:
        print(f"{options.name}: {error}", file=sys.stderr)
        return 1
    except (Interrupted, KeyboardInterrupt):
        return EXIT_INTERRUPTED
    threads = os.environ["OMP_NUM_THREADS"]
    facts = {"device": device(), "threads": threads, "versions": versions()}
    write_report(options.json, {**report, **facts})
    return 0


if __name__ == "__main__":
    sys.exit(main())
