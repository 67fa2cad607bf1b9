"""`pa_ros scatter`: stop a robot that learns, wait for the blocks to be scattered, and continue."""

from __future__ import annotations

import argparse

from pa_ros.core.errors import PaError
from pa_ros.tools.arm import Arm

ASK = "Enter when the blocks are scattered and your hands are away: "


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros scatter`."""
    parser.add_argument("--namespace", default="", help="of the robot (default: none)")


def run(options: argparse.Namespace) -> int:
    """Ask until the robot continues: it refuses while a block is not measured."""
    with Arm(options.namespace) as arm:
        print(arm.scatter())
        while True:
            input(ASK)
            try:
                print(arm.scattered())
                return 0
            except PaError as error:
                print(error)
