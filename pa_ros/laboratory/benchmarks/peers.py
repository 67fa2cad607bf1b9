"""Agents of other libraries on `pa_ros/Reach-v0`, beside ours.

Each has one processor, the same frames and its library's own settings, except for the discount and
TD3's exploration (it has none by default). Each is scored greedily on the same episodes, in time
that does not count. Time is the processor's, so that other work on the machine changes little.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium
import numpy as np

from laboratory.studies.experiments import EXPERIMENTS, Experiment, run_seed
from laboratory.studies.processes import end_with_parent
from laboratory.studies.tables import read_rows, write_rows
from pa_ros.arena import design_named
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation
from pa_ros.core.signals import interrupts_later
from pa_ros.core.text import Report
from pa_ros.evaluation.evaluate import Acts, TrainingScores
from pa_ros.language import Program

OURS = "ours"
PEERS = {  # library and class
    "SAC": ("stable_baselines3", "SAC"),
    "TD3": ("stable_baselines3", "TD3"),
    "TQC": ("sb3_contrib", "TQC"),
    "SBX TQC": ("sbx", "TQC"),
    "SBX CrossQ": ("sbx", "CrossQ"),
}
PACKAGES = {
    "pa_ros": "programmable-agents",
    "stable_baselines3": "stable-baselines3",
    "sb3_contrib": "sb3-contrib",
    "sbx": "sbx-rl",
}
GAMMA = 0.95  # as `ours`
TD3_NOISE = 0.1  # deviation of its exploration (Fujimoto et al. 2018)
EVERY = 2_500  # frames between scores
EPISODES = 50
EQUAL_FRAMES = 15_000
EXPERIMENT = "programmable-2L"


@dataclass(frozen=True, slots=True)
class PeerScore:
    """One evaluation of one contender."""

    contender: str
    library: str  # package and version
    seed: int
    frames: float
    seconds: float  # of a processor, for training alone
    train_success: float  # share of episodes that end with the program satisfied
    train_normalized: float  # 0 at random actions, 1 at the script
    held_out_success: float
    held_out_normalized: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the benchmark's options."""
    parser.add_argument("--seeds", type=int, default=1, help="of each contender (%(default)s)")
    parser.add_argument(
        "--frames", type=int, default=60_000,
        help=f"of each run, a multiple of {EVERY:,} (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--contenders", nargs="+", choices=(OURS, *PEERS), default=(OURS, *PEERS), metavar="NAME"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("docs/results/peers.runs"),
        help="folder of the runs' scores; finished runs are not repeated (%(default)s)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> Report:
    """Train and score the contenders; means over seeds of all runs in the folder.

    Raises ConfigError for a contender whose library is not installed.
    """
    if options.frames % EVERY:
        raise ConfigError(f"--frames: expected a multiple of {EVERY}, got {options.frames}")
    for seed in range(options.seeds):
        for name in options.contenders:
            path = options.runs / f"{name}-{seed}.csv"
            if not path.exists() or read_rows(path, PeerScore)[-1].frames < options.frames:
                _require(name)
                _in_process(name, seed, options.frames, path)
            last = read_rows(path, PeerScore)[-1]
            print(
                f"{name}, seed {seed}: {last.frames:.0f} frames in {last.seconds:.0f} s, "
                f"success {last.train_success:.0%}, held out {last.held_out_success:.0%}",
                flush=True,
            )
    return report(
        [row for path in sorted(options.runs.glob("*.csv")) for row in read_rows(path, PeerScore)]
    )


def report(scores: Sequence[PeerScore]) -> Report:
    """Means over seeds of each contender's scores.

    `peers.NAME.…` are those of the last evaluation, `…at_N.…` those after EQUAL_FRAMES, and
    `….in_time.…` the last within the time in which `ours` made EQUAL_FRAMES.
    """
    found: dict[str, float | int | str] = {}
    by_name: dict[str, dict[int, list[PeerScore]]] = {}
    for row in scores:
        by_name.setdefault(row.contender, {}).setdefault(row.seed, []).append(row)
    ours = [row for row in scores if row.contender == OURS and row.frames == EQUAL_FRAMES]
    within = float(np.mean([row.seconds for row in ours])) if ours else 0.0
    for name, by_seed in by_name.items():
        curves = list(by_seed.values())
        libraries = {row.library for curve in curves for row in curve}
        found[f"peers.{name}.library"] = ", ".join(sorted(libraries))
        found[f"peers.{name}.seeds"] = len(curves)
        found |= _means(f"peers.{name}", [curve[-1] for curve in curves])
        equal = [row for curve in curves for row in curve if row.frames == EQUAL_FRAMES]
        found |= _means(f"peers.{name}.at_{EQUAL_FRAMES}", equal)
        in_time = [[row for row in curve if row.seconds <= within] for curve in curves]
        found |= _means(f"peers.{name}.in_time", [curve[-1] for curve in in_time if curve])
    return found


def _means(name: str, rows: Sequence[PeerScore]) -> dict[str, float | int | str]:
    fields = ("frames", "seconds", "train_success", "held_out_success")
    return {
        f"{name}.{f}": float(np.mean([getattr(row, f) for row in rows])) for f in fields if rows
    }


def _require(name: str) -> None:
    if name != OURS and importlib.util.find_spec(PEERS[name][0]) is None:
        raise ConfigError(f"peers: {name} needs {PEERS[name][0]} (make install-peers)")


def _in_process(name: str, seed: int, frames: int, path: Path) -> None:
    """Train in a separate process on one processor, so that no library uses more threads."""
    with interrupts_later():  # Ctrl-C is for this process, which ends the other
        pool = multiprocessing.get_context("spawn").Pool(1, _use_one_processor)
    with pool:
        pool.apply(run_contender, (name, seed, frames, path))


def _use_one_processor() -> None:
    end_with_parent()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def run_contender(
    name: str, seed: int, frames: int, path: Path, every: int = EVERY, episodes: int = EPISODES
) -> None:
    """Train one contender and write its scores to `path` as they are made."""
    experiment = replace(
        EXPERIMENTS[EXPERIMENT],
        frames=frames,
        evaluate_every_frames=every,
        evaluation_episodes=episodes,
    )
    contender = _Contender(name, seed, experiment, path)
    (contender.train_ours if name == OURS else contender.train_peer)()


class _Contender:
    """One contender with one seed: its scores, and the time that training took."""

    def __init__(self, name: str, seed: int, experiment: Experiment, path: Path) -> None:
        self._name, self._seed, self._experiment, self._path = name, seed, experiment, path
        package = PACKAGES["pa_ros" if name == OURS else PEERS[name][0]]
        self._library = f"{package} {version(package)}"
        arena, design = experiment.arena, design_named(experiment.design)
        self._scores = TrainingScores(arena, design, experiment.evaluation_episodes)
        self._not_training_s = time.process_time()
        self._rows: list[PeerScore] = []

    def train_ours(self) -> None:
        """`ours`, as `pa_ros experiment` trains it."""
        with TemporaryDirectory() as name:
            run_seed(self._experiment, self._seed, Path(name), scores=self._score)

    def train_peer(self) -> None:
        """One of PEERS, on the flat observation."""
        model = self._model()
        greedy = _Greedy(model, self._scores)

        def score(*_: Any) -> bool:
            if model.num_timesteps % self._experiment.evaluate_every_frames == 0:
                self._score(greedy)
            return True

        self._not_training_s = time.process_time()  # loading the library does not count either
        model.learn(self._experiment.frames, callback=score)

    def _model(self) -> Any:
        library, kind = PEERS[self._name]
        design, preset = self._experiment.design, self._experiment.preset
        environment = gymnasium.make("pa_ros/Reach-v0", design=design, preset=preset)
        extra: dict[str, Any] = {} if library == "sbx" else {"device": "cpu"}
        if kind == "TD3":
            from stable_baselines3.common.noise import NormalActionNoise

            joints = environment.action_space.shape or ()
            extra["action_noise"] = NormalActionNoise(np.zeros(joints), np.full(joints, TD3_NOISE))
        make = getattr(importlib.import_module(library), kind)
        return make("MlpPolicy", environment, gamma=GAMMA, seed=self._seed, **extra)

    def _score(self, actor: Acts) -> dict[str, float]:
        """Score the actor, in time that does not count, and write all scores so far."""
        started = time.process_time()
        row: Mapping[str, float] = self._scores(actor)
        frames = (len(self._rows) + 1) * self._experiment.evaluate_every_frames
        figures = [
            row[f"{condition}_greedy.{figure}"]
            for condition in ("train", "eval")
            for figure in ("success_rate", "normalized")
        ]
        seconds = started - self._not_training_s
        self._rows.append(
            PeerScore(self._name, self._library, self._seed, frames, seconds, *figures)
        )
        write_rows(self._path, self._rows)
        self._not_training_s += time.process_time() - started
        return dict(row)


class _Greedy:
    """A library's model as an actor."""

    def __init__(self, model: Any, scores: TrainingScores) -> None:
        self._model, self._task = model, scores.task
        self._flat = model.env.envs[0].unwrapped.flat

    def act(self, observation: Observation, program: Program) -> Float32:
        """The greedy action, [J]."""
        seen = self._flat(observation, self._task)
        action, _state = self._model.predict(seen, deterministic=True)
        return np.asarray(action, np.float32)
