"""Inject faults into a running graph: `make chaos` (ARGS=--short for a minute's worth)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from chaos.campaign import ChaosConfig, campaign
from chaos.report import report, write_table
from pa_ros.cli.options import add_settings, settings_from
from pa_ros.core.errors import PaError
from pa_ros.core.signals import EXIT_INTERRUPTED, Interrupted, signals_interrupt
from pa_ros.core.text import write_report


def main() -> int:
    """Exit status 1 if a row failed."""
    parser = argparse.ArgumentParser(prog="python -m chaos", description=__doc__)
    add_settings(parser, ChaosConfig, "cycles", "minutes", "only")
    parser.add_argument("--short", action="store_true", help="three faults, one cycle each")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep the logs and bags there")
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the rows' table there")
    options = parser.parse_args()
    try:
        with signals_interrupt():
            config = settings_from(options, ChaosConfig)
            rows = campaign(config, lambda line: print(line, flush=True), options.out)
    except PaError as error:
        print(f"chaos: {error}", file=sys.stderr)
        return 2
    except (Interrupted, KeyboardInterrupt):
        return EXIT_INTERRUPTED
    figures = report(rows)
    write_report(options.json, figures)
    if options.table is not None:
        write_table(options.table, rows, "make chaos")
    return int(bool(figures["chaos.failed_rows"]))


if __name__ == "__main__":
    sys.exit(main())
