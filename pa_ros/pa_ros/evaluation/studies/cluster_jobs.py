"""What an experiment asks of a cluster: seeds to train, and agents to score."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pa_ros.evaluation.scoring.agents import load_agent, trained, without_training
from pa_ros.evaluation.scoring.benchmark import Benchmark, Scorer
from pa_ros.evaluation.scoring.blind import BLIND
from pa_ros.evaluation.scoring.evaluate import REFERENCES
from pa_ros.evaluation.studies.cluster import Cluster, Files, Part, read_files, write_files
from pa_ros.evaluation.studies.curves import CURVE
from pa_ros.evaluation.studies.experiments import Experiment, frames_saved, run_seed
from pa_ros.evaluation.studies.generalization import RANDOM_WEIGHTS, conditions_of
from pa_ros.evaluation.studies.seeds import SeedsProgress, folder_of, progress_bar
from pa_ros.language import MIN_MAX, Logic
from pa_ros.learning.checkpoint_files import LATEST, find_checkpoint, remove_older
from pa_ros.learning.checkpoints import ACTING
from pa_ros.learning.folder import checkpoint_of, claim, holds_checkpoint

SCORES = "scores"


def train_seeds_on(
    cluster: Cluster, experiment: Experiment, seeds: Sequence[int], folder: Path
) -> None:
    """As `seeds.train_seeds`, with each seed's parts on nodes of a cluster.

    What a node had reached at a checkpoint lies in the seed's folder here, as if it had been
    trained here, so either way goes on where the other was interrupted.
    """
    jobs = [SeedJob(experiment, seed, folder_of(folder, seed)) for seed in seeds]
    with ExitStack() as stack:
        for job in jobs:
            stack.enter_context(claim(job.folder, resume=True))
        folders = [job.folder for job in jobs]
        progress = stack.enter_context(SeedsProgress(experiment, folders))
        cluster.run(jobs, progress.show, progress.tell)


@dataclass(frozen=True)
class SeedJob:
    """A seed of an experiment; its parts reach from checkpoint to checkpoint."""

    experiment: Experiment
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        return f"seed {self.seed}"

    def part(self) -> Part | None:
        done, frames = frames_saved(self.folder, claimed=True), self.experiment.frames
        if done >= frames:
            return None
        every = self.experiment.checkpoint_every_frames
        until = min(frames, (done // every + 1) * every)
        work = partial(train_part, self.experiment, self.seed, until)
        return Part(work, run_files, run_files(self.folder))

    def take(self, files: Files) -> None:
        write_files(self.folder, files)
        root = checkpoint_of(self.folder)
        remove_older(root, find_checkpoint(root).name)


def train_part(experiment: Experiment, seed: int, until: int, folder: Path) -> None:
    """Go on with a seed until so many frames."""
    run_seed(experiment, seed, folder, until)


def run_files(folder: Path) -> Files:
    """What a run needs to go on: its newest checkpoint and its curve, LATEST last."""
    if not holds_checkpoint(folder):
        return {}
    root = checkpoint_of(folder)
    curve = [path for path in (folder / CURVE,) if path.exists()]
    return read_files(folder, [*sorted(find_checkpoint(root).iterdir()), *curve, root / LATEST])


def score_on(
    cluster: Cluster,
    runs: Mapping[int, Path],
    cache: Path,
    episodes: int = 100,
    conditions: Sequence[str] = (),
    logic: Logic = MIN_MAX,
) -> None:
    """Score trained seeds and references under conditions (default: every one of their design),
    into the cache that `generalization.generalize` reads."""
    jobs = score_jobs(runs, cache, episodes, conditions, logic)
    with progress_bar() as bar:
        task = bar.add_task("generalization", total=len(jobs))

        def show() -> None:
            bar.update(task, completed=sum(job.kept.exists() for job in jobs))

        cluster.run(jobs, show, partial(bar.console.print, markup=False, soft_wrap=True))


@dataclass(frozen=True)
class ScoreJob:
    """One agent, or one reference in its setting, under one condition."""

    name: str
    run: Path
    cache: Path
    kept: Path  # within the cache
    score: Callable[[Path], None]

    def part(self) -> Part | None:
        if self.kept.exists():
            return None
        checkpoint = find_checkpoint(trained(self.run))
        files = read_files(checkpoint, [checkpoint / name for name in ACTING])
        return Part(self.score, score_files, files)

    def take(self, files: Files) -> None:
        write_files(self.cache, files)


def score_jobs(
    runs: Mapping[int, Path],
    cache: Path,
    episodes: int,
    conditions: Sequence[str],
    logic: Logic = MIN_MAX,
) -> list[ScoreJob]:
    """A job for each condition and reference, and for each condition and agent (by seed)."""
    agents = {seed: load_agent(run, logic=logic) for seed, run in runs.items()}
    first, agent = next(iter(agents.items()))
    scorer = Scorer(Benchmark(design=agent.design, arena=agent.arena, episodes=episodes), cache)
    jobs = []
    for condition in conditions or conditions_of(agent.design):
        drawn_from = "train" if condition == RANDOM_WEIGHTS else condition
        for name in (*REFERENCES, *BLIND) if condition == drawn_from else ():
            score = partial(score_reference, name, condition, episodes)
            kept = scorer.path(name, condition)
            jobs.append(ScoreJob(f"{condition}, {name}", runs[first], cache, kept, score))
        for seed, one in agents.items():
            acting = without_training(one, seed) if condition == RANDOM_WEIGHTS else one
            score = partial(score_agent, seed, condition, episodes, logic)
            kept = scorer.path(acting.key, drawn_from)
            jobs.append(ScoreJob(f"{condition}, seed {seed}", runs[seed], cache, kept, score))
    return jobs


def score_reference(name: str, condition: str, episodes: int, folder: Path) -> None:
    """On a node: a reference in the setting of the agent in `folder`."""
    agent = load_agent(folder)
    benchmark = Benchmark(design=agent.design, arena=agent.arena, episodes=episodes)
    Scorer(benchmark, folder / SCORES).reference(name, condition)


def score_agent(seed: int, condition: str, episodes: int, logic: Logic, folder: Path) -> None:
    """On a node: the agent in `folder`, of that seed."""
    agent = load_agent(folder, logic=logic)
    benchmark = Benchmark(design=agent.design, arena=agent.arena, episodes=episodes)
    acting = without_training(agent, seed) if condition == RANDOM_WEIGHTS else agent
    drawn_from = "train" if condition == RANDOM_WEIGHTS else condition
    Scorer(benchmark, folder / SCORES).agent(acting, drawn_from)


def score_files(folder: Path) -> Files:
    """The scores that a node made, as they lie in a cache."""
    return read_files(folder / SCORES, (folder / SCORES).rglob("*.csv"))
