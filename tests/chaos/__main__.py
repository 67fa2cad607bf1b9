"""Inject faults into running graphs: `make chaos`, or for a minute `make chaos ARGS=--short`."""

import argparse
import sys
import time
from pathlib import Path

from chaos.attacks import attack
from chaos.campaign import campaign, chosen, write_table
from chaos.soak import soak
from pa_ros.core.errors import PaError
from pa_ros.core.signals import EXIT_INTERRUPTED, Interrupted, signals_interrupt


def main() -> int:
    """Exit status 1 if a row failed."""
    parser = argparse.ArgumentParser(prog="python -m chaos", description=__doc__)
    parser.add_argument("--cycles", type=int, default=200, help="faults in all (%(default)s)")
    parser.add_argument("--only", nargs="+", default=(), metavar="TEXT",
                        help="faults whose name contains one of these")  # fmt: skip
    parser.add_argument("--short", action="store_true", help="three faults, one cycle each")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep logs and bags there")
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the table into this page")
    parser.add_argument(
        "--soak", type=float, metavar="S", help="only kill a node every 20 s, so long"
    )
    parser.add_argument("--robot", action="store_true", help="only attack robot_node at random")
    parser.add_argument("--minutes", type=float, default=10.0, help="of --robot (%(default)s)")
    parser.add_argument("--seed", type=int, default=time.time_ns() % 10**6, help="of --robot")
    options = parser.parse_args()
    try:
        with signals_interrupt():
            if options.soak:
                return int(not soak(options.soak, options.out))
            if options.robot:
                return int(not attack(options.minutes, options.seed, options.out))
            faults = chosen(options.only, options.short)
            cycles = len(faults) if options.short else options.cycles
            rows = campaign(faults, cycles, options.out)
    except PaError as error:
        print(f"chaos: {error}", file=sys.stderr)
        return 2
    except (Interrupted, KeyboardInterrupt):
        return EXIT_INTERRUPTED
    if options.table is not None:
        write_table(options.table, rows)
    return int(any(row.failed for row in rows))


if __name__ == "__main__":
    sys.exit(main())
