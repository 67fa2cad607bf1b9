"""`pa_ros chaos`: harm done on purpose to a graph that learns, and what came of it."""

from __future__ import annotations

import argparse

from pa_ros.cli.options import add_settings, file_to_write, folder_to_write, settings_from
from pa_ros.core.report import write_report
from pa_ros.tools.chaos.campaign import ChaosConfig, campaign
from pa_ros.tools.chaos.report import report, write_table

EXIT_FAILED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros chaos`."""
    add_settings(parser, ChaosConfig, "cycles", "minutes", "only")
    parser.add_argument("--short", action="store_true", help="a minute: three rows of processes")
    parser.add_argument("--json", type=file_to_write, help="also write the figures to this file")
    parser.add_argument(
        "--out", type=folder_to_write, metavar="DIR", help="keep the logs and bags there"
    )
    parser.add_argument(
        "--table", type=file_to_write, metavar="FILE", help="write the rows as FAULTS.md"
    )
    parser.epilog = "exit status 1 if a row failed"


def run(options: argparse.Namespace) -> int:
    """Do it, report, and write the table."""
    config = settings_from(options, ChaosConfig)
    rows = campaign(config, lambda line: print(line, flush=True), options.out)
    figures = report(rows)
    write_report(options.json, figures)
    if options.table is not None:
        changed = "" if config.cycles == 200 else f" --cycles {config.cycles}"
        write_table(options.table, rows, f"pa_ros chaos{changed} --table FAULTS.md")
    return EXIT_FAILED if figures["chaos.failed_rows"] else 0
