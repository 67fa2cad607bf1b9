"""Other libraries' agents on `pa_ros/Reach-v0` beside ours: `pa_ros bench peers`.

Each has one processor, the same frames, and the library's own settings but for the discount, and
TD3's exploration, which it has none of by default. Each is scored greedily on the same episodes, in
time that doesn't count. Time is the processor's, so that other work on the machine changes little.
"""

from __future__ import annotations

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

from pa_ros.arena import design_named, preset_named
from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, Observation
from pa_ros.core.report import Report
from pa_ros.core.signals import end_with_parent, interrupts_later
from pa_ros.evaluation.scoring.tables import read_rows, write_rows
from pa_ros.evaluation.scoring.training import Acts, TrainingScores
from pa_ros.evaluation.studies.experiments import Experiment, experiment_named, run_seed
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
class Score:
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


def bench_peers(folder: Path, seeds: int, contenders: Sequence[str], frames: int) -> Report:
    """Train every contender (none named: all) and score it on the way.

    `peers.NAME.…`: the last scores, those after EQUAL_FRAMES, and those of the last evaluation
    within the time in which `ours` had made its EQUAL_FRAMES; means over the seeds. `folder` has
    each run's scores as soon as they are made; runs of at least as many frames that it holds are
    not made again, and a shorter one stays until its successor has more. Raises ConfigError for a
    contender whose library isn't installed, and for frames that are not a multiple of EVERY.
    """
    if frames % EVERY:
        raise ConfigError(f"--frames: expected a multiple of {EVERY}, got {frames}")
    named = tuple(contenders) or (OURS, *PEERS)
    paths = {(name, seed): folder / f"{name}-{seed}.csv" for seed in range(seeds) for name in named}
    missing = [run for run, path in paths.items() if not _reaches(path, frames)]
    for name, _seed in missing:
        _require(name)
    for (name, seed), path in paths.items():
        if (name, seed) in missing:
            _apart(name, seed, frames, path)
        last = read_rows(path, Score)[-1]
        share, held_out = last.train_success, last.held_out_success
        print(
            f"{name}, seed {seed}: {last.frames:.0f} frames in {last.seconds:.0f} s, "
            f"success {share:.0%}, held out {held_out:.0%}",
            flush=True,
        )
    return report(scores_in(folder))


def _reaches(path: Path, frames: int) -> bool:
    return path.exists() and read_rows(path, Score)[-1].frames >= frames


def scores_in(folder: Path) -> list[Score]:
    """All scores that a folder holds."""
    return [row for path in sorted(folder.glob("*.csv")) for row in read_rows(path, Score)]


def report(scores: Sequence[Score]) -> Report:
    """Means over seeds, of each contender."""
    found: dict[str, float | int | str] = {}
    by_name: dict[str, dict[int, list[Score]]] = {}
    for row in scores:
        by_name.setdefault(row.contender, {}).setdefault(row.seed, []).append(row)
    ours = [row for row in scores if row.contender == OURS and row.frames == EQUAL_FRAMES]
    within = float(np.mean([row.seconds for row in ours])) if ours else 0.0
    for name, by_seed in by_name.items():
        curves = list(by_seed.values())
        libraries = {row.library for curve in curves for row in curve}
        found[f"peers.{name}.library"] = ", ".join(sorted(libraries))
        found[f"peers.{name}.seeds"] = len(curves)
        found |= _figures(f"peers.{name}", [curve[-1] for curve in curves])
        equal = [row for curve in curves for row in curve if row.frames == EQUAL_FRAMES]
        found |= _figures(f"peers.{name}.at_{EQUAL_FRAMES}", equal)
        in_time = [[row for row in curve if row.seconds <= within] for curve in curves]
        found |= _figures(f"peers.{name}.in_time", [curve[-1] for curve in in_time if curve])
    return found


def _figures(name: str, rows: Sequence[Score]) -> dict[str, float | int | str]:
    fields = ("frames", "seconds", "train_success", "held_out_success")
    return {
        f"{name}.{f}": float(np.mean([getattr(row, f) for row in rows])) for f in fields if rows
    }


def _require(name: str) -> None:
    if name == OURS:
        return
    if name not in PEERS:
        raise ConfigError(f"peers: expected of {(OURS, *PEERS)}, got {name!r}")
    library = PEERS[name][0]
    if importlib.util.find_spec(library) is None:  # loaded only where it is used
        raise ConfigError(
            f"peers: {name} expects {library} (the extra `peers`: make install-peers)"
        )


def _apart(name: str, seed: int, frames: int, path: Path) -> None:
    """In a process of its own, on one processor, so that no library's threads help it."""
    with interrupts_later():  # Ctrl-C is for this process, which ends the other
        apart = multiprocessing.get_context("spawn").Pool(1, _alone)
    with apart as pool:
        pool.apply(run_contender, (name, seed, frames, path))


def _alone() -> None:
    end_with_parent()
    os.environ["OMP_NUM_THREADS"] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def run_contender(
    name: str, seed: int, frames: int, path: Path, every: int = EVERY, episodes: int = EPISODES
) -> None:
    """Train one contender; its scores are in `path` as they are made."""
    experiment = replace(
        experiment_named(EXPERIMENT),
        frames=frames,
        evaluate_every_frames=every,
        evaluation_episodes=episodes,
    )
    run = _Run(name, seed, experiment, path)
    (run.train_ours if name == OURS else run.train_peer)()


class _Run:
    """One contender with one seed: its scores, and the time that they took."""

    def __init__(self, name: str, seed: int, experiment: Experiment, path: Path) -> None:
        self._name, self._seed, self._experiment, self._path = name, seed, experiment, path
        package = PACKAGES["pa_ros" if name == OURS else PEERS[name][0]]
        self._library = f"{package} {version(package)}"
        arena, design = preset_named(experiment.preset), design_named(experiment.design)
        self._scores = TrainingScores(arena, design, experiment.evaluation_episodes)
        self._not_training_s = time.process_time()
        self._rows: list[Score] = []
        self._rows_there = len(read_rows(path, Score)) if path.exists() else 0

    def train_ours(self) -> None:
        """`ours`, as `pa_ros experiment` trains it."""
        with TemporaryDirectory() as name:
            run_seed(self._experiment, self._seed, Path(name), scores=self._scored)

    def train_peer(self) -> None:
        """One of PEERS, on the flat observation."""
        model = self._model()
        greedy = _Greedy(model, self._scores)

        def score(*_: Any) -> bool:
            if model.num_timesteps % self._experiment.evaluate_every_frames == 0:
                self._scored(greedy)
            return True

        self._not_training_s = time.process_time()  # loading the library isn't, either
        model.learn(self._experiment.frames, callback=score)

    def _model(self) -> Any:
        library, kind = PEERS[self._name]
        design, preset = self._experiment.design, self._experiment.preset
        environment = gymnasium.make("pa_ros/Reach-v0", design=design, preset=preset)
        own: dict[str, Any] = {} if library == "sbx" else {"device": "cpu"}
        if kind == "TD3":
            from stable_baselines3.common.noise import NormalActionNoise

            joints = environment.action_space.shape or ()
            own["action_noise"] = NormalActionNoise(np.zeros(joints), np.full(joints, TD3_NOISE))
        make = getattr(importlib.import_module(library), kind)
        return make("MlpPolicy", environment, gamma=GAMMA, seed=self._seed, **own)

    def _scored(self, actor: Acts) -> dict[str, float]:
        """Score it, once every so many frames, in time that doesn't count."""
        started = time.process_time()
        row = self._scores(actor)
        frames = (len(self._rows) + 1) * self._experiment.evaluate_every_frames
        self._add(frames, started - self._not_training_s, row)
        self._not_training_s += time.process_time() - started
        return row

    def _add(self, frames: float, seconds: float, row: Mapping[str, float]) -> None:
        figures = [
            row[f"{condition}_greedy.{figure}"]
            for condition in ("train", "eval")
            for figure in ("success_rate", "normalized")
        ]
        who = self._name, self._library, self._seed
        self._rows.append(Score(*who, frames, seconds, *figures))
        if len(self._rows) > self._rows_there:
            write_rows(self._path, self._rows)


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
