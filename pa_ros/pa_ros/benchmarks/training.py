"""Frames per second of the whole loop in one process, as a share of the bare update rate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

from pa_ros.acting.actor import Actor
from pa_ros.benchmarks.learner import bare_updates
from pa_ros.benchmarks.rounds import Contender, Slice, measure
from pa_ros.core.experience import Float64
from pa_ros.core.report import Report
from pa_ros.language import Program
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.loop import Environment, TrainConfig, train
from pa_ros.networks.config import NetworkConfig


class _Alternation:
    """Between parts of the training run, the same updates alone."""

    def __init__(self, bare: Contender, slice_s: float) -> None:
        self.bare = bare
        self.parts_s: list[float] = []
        self._slice_s = slice_s
        self._resumed = perf_counter()

    def __call__(self, _: Actor) -> dict[str, float]:
        """Stands for the evaluation of `train`: called every so many frames, the learner idle."""
        self.parts_s.append(perf_counter() - self._resumed)
        measure([self.bare], 1, self._slice_s)
        self._resumed = perf_counter()
        return {}


def bench_train(
    network: NetworkConfig,
    config: LearnerConfig,
    programs: Sequence[Program],
    environment: Environment,
    max_speed: Float64,
    rounds: int = 9,
    frames: int = 2000,
    slice_s: float = 0.5,
) -> Report:
    """Medians over `rounds` parts of `frames` frames, one update each, after one not counted."""
    bare = bare_updates(network, config, programs)
    alternation = _Alternation(bare, slice_s)
    with TemporaryDirectory() as folder:
        settings = TrainConfig(
            out=Path(folder),
            frames=(rounds + 1) * frames,
            evaluate_every_frames=frames,
            checkpoint_every_frames=0,
        )
        starting = config.changed(**{"replay.warmup_frames": 0})
        train(settings, network, starting, environment, max_speed, programs, alternation)
    rates = [frames / seconds for seconds in alternation.parts_s[1:]]
    bare_rate = median(map(_rate, bare.slices[1:])) * config.updates.per_frame
    return {
        "train.frames_per_s": median(rates),
        "train.frames_per_s_low": min(rates),
        "train.frames_per_s_high": max(rates),
        "train.bare_updates_per_s": bare_rate,
        "train.bare_cpu_share": bare.share,
        "train.share_of_bare": median(rates) / bare_rate,
    }


def _rate(part: Slice) -> float:
    return part.calls / part.wall_s
