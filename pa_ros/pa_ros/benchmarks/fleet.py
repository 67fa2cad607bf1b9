"""Whether slow arenas pay off, several for one learner: `pa_ros bench fleet`."""

from __future__ import annotations

import json
import os
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from pa_ros.acting.actor import Actor
from pa_ros.arena import ReachTask, design_named, preset_named
from pa_ros.benchmarks.fleet_runs import UNTHROTTLED_S, Heard, Request, heard
from pa_ros.core.experience import PolicySnapshot
from pa_ros.core.report import Report
from pa_ros.evaluation.scoring.evaluate import REFERENCES, reference_scores, run_episodes
from pa_ros.evaluation.scoring.rewards import normalized, rewards
from pa_ros.evaluation.scoring.training import EVALUATION_SEED

DESIGN, PRESET = "2-L", "fast"
SIZES = (1, 2, 4, 8)
UNTHROTTLED_SIZES, UPDATES_PER_FRAME = (1, 2, 4), (1.0, 0.5, 0.25)
REAL_TIME_FACTOR = 10.0  # 100 control steps a second
FRAMES = 20_000  # of a run that does not come to GOAL before
GOAL = 0.9  # of the held-out programs' normalized reward
EPISODES = 50  # of each evaluation
SCORED_EVERY = 5  # versions: 500 frames


@dataclass
class Run:
    """What came of one run; one file each, so that a benchmark that was stopped goes on."""

    arenas: int
    seed: int
    updates_per_frame: float
    throttled: bool
    frames_per_s: float = 0.0
    updates_per_s: float = 0.0
    seconds: float | None = None  # to GOAL, from the learner's first weights; None: not in FRAMES
    frames: float | None = None  # to GOAL
    too_old: int = 0  # trajectories
    interrupted: int = 0  # trajectories broken off, since a command came too late
    load: float = 0.0  # the machine's, when it began: other work beside it
    curve: list[tuple[float, float, float]] = field(default_factory=list)  # s, frames, score


class HeldOut:
    """The normalized reward of an actor on the held-out programs, on fixed episodes."""

    def __init__(self) -> None:
        config, design = preset_named(PRESET), design_named(DESIGN)
        self._task = ReachTask(config, design, EVALUATION_SEED)
        self._speeds = np.array(config.joint_speed_limits)
        self._script, self._chance = (
            float(rewards(reference_scores(self._task, name, "eval", EPISODES)).mean())
            for name in REFERENCES
        )

    def __call__(self, snapshot: PolicySnapshot) -> float:
        actor, task = Actor.fitting(snapshot), self._task
        actor.load(snapshot)
        scores = list(
            run_episodes(
                task,
                lambda o: actor.act(o, task.program).astype(np.float64) * self._speeds,
                "eval",
                EPISODES,
            )
        )
        return normalized(float(rewards(scores).mean()), self._chance, self._script)


def bench_fleet(folder: Path, seeds: int = 3, sizes: Sequence[int] = SIZES) -> Report:
    """Arenas at REAL_TIME_FACTOR, nobody waiting for anybody (in_step=free), one update per frame:
    seconds until the held-out programs' score is GOAL (`fleet.seconds_N`, medians over the seeds
    that came there, `fleet.reached_N`), and how often as fast as one arena (`fleet.speedup_N`).
    Then arenas in lockstep, as fast as all goes: `fleet.unthrottled_N_at_U` frames per second at U
    updates per frame.

    Runs that `folder` holds are not made again.
    """
    folder.mkdir(parents=True, exist_ok=True)
    score: HeldOut | None = None
    for run in planned(seeds, sizes):
        path = folder / f"{_name(run)}.json"
        if path.exists():
            continue
        run.load = os.getloadavg()[0]
        found = heard(_request(run), SCORED_EVERY)
        run.too_old, run.interrupted = found.too_old, found.interrupted
        run.frames_per_s, run.updates_per_s = found.frames_per_s, found.updates_per_s
        if run.throttled:
            score = score or HeldOut()
            _score(run, found, score)
        path.write_text(json.dumps(asdict(run)))
        print(f"{_name(run)}: {_said(run)}", flush=True)
    return report(runs_in(folder))


def planned(seeds: int, sizes: Sequence[int]) -> Iterator[Run]:
    """The runs, those that say most first: whole seeds, so that it may be stopped between them."""
    for seed in range(seeds):
        yield from (Run(size, seed, 1.0, True) for size in sizes)
        if seed == 0:
            for size in UNTHROTTLED_SIZES:
                yield from (Run(size, 0, ratio, False) for ratio in UPDATES_PER_FRAME)


def runs_in(folder: Path) -> list[Run]:
    """The runs that a folder holds."""
    return [Run(**json.loads(path.read_text())) for path in sorted(folder.glob("*.json"))]


def report(runs: Sequence[Run]) -> Report:
    """Medians of what was run, and how many runs they are of."""
    found: dict[str, float | int | str] = {"fleet.frames_at_most": FRAMES}
    throttled = [run for run in runs if run.throttled]
    for size in sorted({run.arenas for run in throttled}):
        those = [run for run in throttled if run.arenas == size]
        reached = [run.seconds for run in those if run.seconds is not None]
        found[f"fleet.runs_{size}"], found[f"fleet.reached_{size}"] = len(those), len(reached)
        found[f"fleet.frames_per_s_{size}"] = statistics.median(r.frames_per_s for r in those)
        found[f"fleet.too_old_{size}"] = sum(run.too_old for run in those)
        found[f"fleet.interrupted_{size}"] = sum(run.interrupted for run in those)
        if reached:
            found[f"fleet.seconds_{size}"] = statistics.median(reached)
    for size in SIZES[1:]:
        if {"fleet.seconds_1", f"fleet.seconds_{size}"} <= found.keys():
            one, several = found["fleet.seconds_1"], found[f"fleet.seconds_{size}"]
            found[f"fleet.speedup_{size}"] = float(one) / float(several)
    for run in runs:
        if not run.throttled:
            name = f"fleet.unthrottled_{run.arenas}_at_{run.updates_per_frame:g}"
            found[name] = run.frames_per_s
    found["fleet.load_highest"] = max((run.load for run in runs), default=0.0)
    return found


def _request(run: Run) -> Request:
    sim = {"design": DESIGN, "preset": PRESET, "seed": 100 * run.seed}
    options = [f"learner.updates.per_frame={run.updates_per_frame}"]
    if not run.throttled:
        return Request(run.arenas, sim, run.seed, options, "arrival", seconds=UNTHROTTLED_S)
    # Commands may come half a second late on a busy machine before the arm holds.
    sim |= {"mode": "real_time", "real_time_factor": REAL_TIME_FACTOR, "command_timeout_s": 5.0}
    return Request(run.arenas, sim, run.seed, options, "free", frames=FRAMES)


def _score(run: Run, found: Heard, score: HeldOut) -> None:
    """Score versions in their order until one is good enough."""
    for seconds, frames, snapshot in found.versions:
        run.curve.append((seconds, frames, score(snapshot)))
        if run.curve[-1][2] >= GOAL:
            run.seconds, run.frames = seconds, frames
            return


def _name(run: Run) -> str:
    kind = "throttled" if run.throttled else f"unthrottled-{run.updates_per_frame:g}"
    return f"{kind}-{run.arenas}-{run.seed}"


def _said(run: Run) -> str:
    rate = f"{run.frames_per_s:.0f} frames/s, {run.updates_per_s:.0f} updates/s"
    if not run.throttled:
        return rate
    best = max((score for *_, score in run.curve), default=0.0)
    reached = f"{GOAL} after {run.seconds:.0f} s" if run.seconds else f"at most {best:.2f}"
    at = time.strftime("%H:%M:%S")
    return f"{rate}, {reached}, {run.too_old} too old, {run.interrupted} interrupted ({at})"
