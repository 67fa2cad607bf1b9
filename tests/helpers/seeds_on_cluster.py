"""The driver of evaluation/test_cluster.py, on one of its hosts: small seeds are trained."""

import sys
from dataclasses import replace
from pathlib import Path

from helpers.waiting import wait_for
from laboratory.studies.cluster import Cluster, train_seeds_on
from laboratory.studies.experiments import EXPERIMENTS

SEEDS = (0, 1)
SMALL = replace(
    EXPERIMENTS["programmable-2L"], frames=2000, evaluate_every_frames=500, evaluation_episodes=1
)


def main(address: str, folder: Path, ended: Path) -> None:
    import ray

    status = "1"
    try:
        with Cluster(address) as cluster:
            wait_for(lambda: len(ray.nodes()) == 2, "both nodes")
            train_seeds_on(cluster, SMALL, SEEDS, folder / "runs")
        status = "0"
    finally:
        ended.write_text(status)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
