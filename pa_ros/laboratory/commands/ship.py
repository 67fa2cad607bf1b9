"""`pa_ros ship RUN NAME`: make a run's policy one of the package's own."""

from __future__ import annotations

import argparse
from pathlib import Path

SCORES = Path("runs/experiments/scores")  # so that an interrupted call can continue


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `pa_ros ship`."""
    parser.add_argument("run", type=Path, help="folder that a training run left")
    parser.add_argument("name", help="shipped:NAME is what it will be called")
    parser.add_argument(
        "--replace", action="store_true", help="the policy of that name, if there is one"
    )


def run_card(run: Path, cache: Path) -> dict[str, object]:
    """Scores on fresh episodes and versions, for the policy's metadata."""
    from laboratory.studies.experiments import FINAL_EPISODES, final_scores
    from pa_ros.agents import load_agent
    from pa_ros.core.software import device, versions

    held_out, trained = final_scores(run, cache)
    score = load_agent(run).design.skill.score
    return {
        "episodes": FINAL_EPISODES,
        f"held_out.{score}": held_out,
        f"train.{score}": trained,
        "versions": versions(),
        "device": device(),
    }


def run(options: argparse.Namespace) -> int:
    """Score the policy, then write it with its model card; prints the folder."""
    from laboratory.studies.cards import model_card
    from laboratory.studies.shipping import check_ship_name, ship
    from pa_ros.core.files import write_whole

    check_ship_name(options.name, options.replace)  # before it is scored
    card = run_card(options.run, SCORES)
    folder = ship(options.run, options.name, card, options.replace)
    write_whole(folder / "README.md", model_card(folder))
    print(folder)
    return 0
