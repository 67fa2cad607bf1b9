"""`pa_ros figures`: draw the pictures of tables that experiments left."""

from __future__ import annotations

import argparse

from laboratory.commands.experiment import add_results
from pa_ros.core.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros figures`."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="tables (default: all)")
    add_results(parser)


def run(options: argparse.Namespace) -> int:
    """Draw each table's picture beside it, and print the path."""
    from laboratory.studies.learning_figures import is_curves, learning_figure
    from laboratory.studies.results import redraw_generalization

    draw = {}
    for table in sorted(options.results.glob("*.csv")):
        if is_curves(table):
            draw[table.stem] = learning_figure
        elif table.stem.split(".")[0] == "generalization":
            draw[table.stem] = redraw_generalization
    if unknown := sorted(set(options.names) - draw.keys()):
        raise ConfigError(f"figures: expected tables of {sorted(draw)}, got {unknown}")
    for name in options.names or draw:
        print(draw[name](options.results / f"{name}.csv"))
    return 0
