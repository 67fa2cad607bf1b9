"""How much sooner several slow arenas bring one learner to its goal than one does."""

from __future__ import annotations

import argparse
import statistics
import time
from functools import partial

from laboratory.benchmarks.graph import run_graph
from pa_ros.acting.executing import Actor
from pa_ros.arena import design_named, preset_named
from pa_ros.core.experience import PolicySnapshot
from pa_ros.core.text import Report
from pa_ros.evaluation.evaluate import TrainingScores
from pa_ros.ros.topics import POLICY_WEIGHTS
from pa_ros.tools.domain import use_free_domain
from pa_ros.tools.launch_params import Parameters, fleet, in_step
from pa_ros.tools.monitor import GraphFigures
from pa_ros.wire import Message
from pa_ros.wire.learning import decode_weights

DESIGN, PRESET = "2-L", "fast"
REAL_TIME_FACTOR = 10.0  # 100 control steps per second and arena
FRAMES = 20_000  # of a run that does not reach GOAL earlier
GOAL = 0.9  # normalized reward of the held-out programs
EPISODES = 50  # of each score
SCORED_EVERY = 5  # versions, that is 500 frames
TIMEOUT_S = 1800.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--seeds", type=int, default=3, help="of each size (%(default)s)")
    parser.add_argument("--arenas", type=int, nargs="+", default=[1, 2, 4, 8], metavar="N",
                        help="sizes of the fleet (%(default)s)")  # fmt: skip
    parser.add_argument("--compose", action="store_true",
                        help="each arena and its agent in one process")  # fmt: skip


def run(options: argparse.Namespace) -> Report:
    """Seconds until the score of the held-out programs reaches GOAL, medians over seeds.

    Arenas run at REAL_TIME_FACTOR and nothing waits (`in_step=free`), with one update per frame.
    `fleet.seconds_N` counts the seeds that reached GOAL; `fleet.reached_N` says how many did.
    """
    use_free_domain()
    score = TrainingScores(preset_named(PRESET), design_named(DESIGN), EPISODES)
    report: dict[str, float] = {}
    for arenas in options.arenas:
        runs = [measure(arenas, seed, score, options.compose) for seed in range(options.seeds)]
        reached = [seconds for _, seconds in runs if seconds is not None]
        report[f"fleet.frames_per_s_{arenas}"] = statistics.median(rate for rate, _ in runs)
        report[f"fleet.reached_{arenas}"] = len(reached)
        if reached:
            report[f"fleet.seconds_{arenas}"] = statistics.median(reached)
    return report


def _parameters(arenas: int, seed: int) -> Parameters:
    # On a busy machine commands may arrive late; the arm holds only after five seconds.
    timing = {"real_time_factor": REAL_TIME_FACTOR, "command_timeout_s": 5.0}
    scene = {"design": DESIGN, "preset": PRESET, "seed": 100 * seed}
    one: Parameters = {
        "sim_node": scene | timing | {"mode": "real_time"},
        "agent_node": {"learning": True, "seed": 100 * seed},
        "learner_node": {"seed": seed, "learner.updates.per_frame": 1.0},
    }
    return in_step(fleet(one, arenas), "free")


def measure(
    arenas: int, seed: int, scores: TrainingScores, compose: bool
) -> tuple[float, float | None]:
    """Frames per second of one run, and seconds until GOAL (None: not within FRAMES)."""
    policies: dict[int, tuple[float, PolicySnapshot]] = {}
    marks: list[tuple[float, float]] = []  # s, frames

    def keep(message: Message) -> None:
        policy = decode_weights(message)
        version = policy.snapshot.version
        if not policies or version >= max(policies) + SCORED_EVERY:
            policies[version] = policy.stamp_ns * 1e-9, policy.snapshot

    def sample(figures: GraphFigures) -> None:
        frames = figures.value("learner_node", "frames") or 0.0
        if frames and (not marks or frames != marks[-1][1]):
            marks.append((time.monotonic(), frames))

    def finished() -> bool:
        return len(marks) > 1 and marks[-1][1] >= FRAMES

    parameters = _parameters(arenas, seed)
    listen = partial(POLICY_WEIGHTS.subscribe, callback=keep)
    run_graph(parameters, sample, finished, TIMEOUT_S, compose, listen)
    rate = (marks[-1][1] - marks[0][1]) / (marks[-1][0] - marks[0][0])
    began = policies[min(policies)][0]

    def good(policy: PolicySnapshot) -> bool:
        return scores(Actor.of(policy))["eval_greedy.normalized"] >= GOAL

    seconds = next((at - began for _, (at, one) in sorted(policies.items()) if good(one)), None)
    reached = "not reached" if seconds is None else f"after {seconds:.0f} s"
    print(f"{arenas} arenas, seed {seed}: {rate:.0f} frames/s, {GOAL} {reached}", flush=True)
    return rate, seconds
