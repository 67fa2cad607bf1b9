"""The learning side: replay buffer, updates in a fixed ratio to frames, and published weights."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.acting.errors import ActingError
from pa_ros.core.experience import Float32, PolicySnapshot
from pa_ros.core.update import Batch
from pa_ros.language import Program
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.errors import DivergedError
from pa_ros.learning.relabeling.all_goals import Int32, Marks, Relabeler
from pa_ros.learning.relabeling.property_dropout import PropertyDropout
from pa_ros.learning.replay_buffer.buffer import InsertReport, Int64, ReplayBuffer
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import not_finite
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.poses import POSE_WIDTH
from pa_ros.world.programs import ProgramTable

LEARNER_STREAM = 2  # of default_rng([seed, stream])
# Before so many updates and more the state is kept, to go back to, and afterwards all of it is
# looked at: that costs about as much as one update.
KEPT_BEFORE = 80


@dataclass(frozen=True, slots=True)
class ConsumeReport:
    """What one trajectory led to."""

    insert: InsertReport
    updates: int
    version: int  # of the weights now; grew by one if the trajectory was accepted


@dataclass
class Counters:
    """What a learner has done so far; all of it is in its checkpoint."""

    version: int = 0  # trajectories accepted
    frames: int = 0  # transitions accepted
    episodes: int = 0
    updates: int = 0
    frames_due: int = 0  # transitions that updates are due for: all but the warm-up's


@dataclass(frozen=True)
class _Kept:
    """A learner before a trajectory, but for its replay buffer."""

    counters: Counters
    rng: Mapping[str, Any]
    tensors: dict[str, NDArray[Any]]


class Learner:
    """Consumes trajectories, publishes policies; one seed and one order, one result.

    `training_programs` are the ones that relabeling draws from; programs of trajectories
    join the table as they come.
    """

    def __init__(
        self,
        network: NetworkConfig,
        config: LearnerConfig,
        training_programs: Sequence[Program],
        seed: int,
        scoring: Scoring | None = None,
        n_objects: int | None = None,
    ) -> None:
        """`config` says by which algorithm; ConfigError if that is not registered or is none.

        `scoring` is the arena's, which relabeling asks; unless given, the paper's reward
        at the relations' own thresholds. `n_objects`: of the arena's scenes, the hand included;
        None: as the first trajectory has them.
        """
        self.network = network
        self.scoring = scoring or Scoring.of(network.vocabulary.relations)
        self.config = config
        self.counters = Counters()
        self.rng = np.random.default_rng([seed, LEARNER_STREAM])
        self.table = ProgramTable(network.vocabulary)
        for program in training_programs:
            self._row(program)
        self._relabeler = None
        if config.relabeling.rule == "all-goals":
            self._relabeler = Relabeler(training_programs, network.world, self.scoring)
        self._dropout = None
        if config.relabeling.property_dropout and family_of(network).evaluates_programs:
            self._dropout = PropertyDropout(
                self.table, network.world, config.relabeling.property_dropout
            )
        goals = self._relabeler.rewards_kept if self._relabeler else 0
        self.replay = ReplayBuffer(config.replay.capacity_frames, network.world, n_objects, goals)
        algorithm = ALGORITHMS[config.ALGORITHM]
        self.engine = algorithm.engine(network, config, self.table, self.rng)
        kept = config.schedule.versions_kept
        self.published: deque[PolicySnapshot] = deque([self._snapshot(0)], maxlen=kept)

    def consume(self, trajectory: Trajectory) -> ConsumeReport:
        """Insert a trajectory, make the updates that it is due, publish one version more.

        A duplicate is counted and does nothing else. Raises LearningError or ProgramError, with
        nothing changed, for a trajectory that cannot be used; DivergedError, with no version more,
        once numbers are not finite. If that says `restored`, the learner is as it was before the
        trajectory, but for its replay buffer; else it is not to be used any more.
        """
        self.replay.check(trajectory)
        program = self._row(trajectory.program)
        marks = None
        if self._relabeler is not None:
            marks = self._relabeler.marks(
                trajectory.objects, trajectory.hand_index, trajectory.arm[:, -POSE_WIDTH:]
            )
        report = self.replay.insert(trajectory, program, marks)
        if not report.accepted:
            return ConsumeReport(report, 0, self.counters.version)
        counters = replace(self.counters)
        self.counters.frames += len(trajectory)
        updates = self._updates_due(len(trajectory))
        kept = self._keep(counters) if updates >= KEPT_BEFORE else None
        self.update(updates)
        newest = self._snapshot(self.counters.version + 1)
        self._check_finite(newest, kept)
        if trajectory.ends_episode:
            self.counters.episodes += 1
            self.engine.end_episode()
        self.counters.version = newest.version
        self.published.append(newest)
        return ConsumeReport(report, updates, self.counters.version)

    def _keep(self, counters: Counters) -> _Kept:
        return _Kept(counters, self.rng.bit_generator.state, self.engine.tensors())

    def _go_back(self, kept: _Kept) -> None:
        self.counters, self.rng.bit_generator.state = kept.counters, kept.rng
        self.engine.load_tensors(kept.tensors)

    def _check_finite(self, newest: PolicySnapshot, kept: _Kept | None) -> None:
        """Raise DivergedError unless the latest update and the actor are made of finite numbers."""
        figures = self.engine.metrics()
        wrong = [name for name, value in figures.items() if not math.isfinite(value)]
        wrong += [f"actor.{name}" for name in not_finite(newest.tensors)]
        if kept is not None and not wrong:  # a sum of finite float32 is a finite float64
            sums = {k: v.sum(dtype=np.float64) for k, v in self.engine.tensors().items()}
            wrong = [name for name, total in sums.items() if not np.isfinite(total)]
        if wrong:
            shown = ", ".join(f"{name} {value:g}" for name, value in figures.items())
            error = DivergedError(
                f"learner: expected finite numbers, got others in {', '.join(wrong)} at update "
                f"{self.counters.updates} ({shown}): learning stopped after version "
                f"{self.counters.version}, whose weights are the last good ones; smaller learning "
                "rates or rewards may help"
            )
            if kept is not None:
                self._go_back(kept)
                error.restored = True
            raise error

    def update(self, updates: int) -> None:
        """Make this many updates, whether due or not; LearningError without transitions."""
        for batch in self.batches(updates):
            self.engine.update(batch)
            self.counters.updates += 1

    def batches(self, updates: int) -> Iterator[Batch]:
        """Batches for this many updates, drawn at once: the replay buffer does not change."""
        size = self.config.replay.batch_size
        if updates == 0:
            return
        index = self.replay.sample(self.rng, updates * size)
        following = self.replay.following(index)
        program, reward = self._programs(index, following)
        discount, hidden = self._discount(index), self._hidden(len(index))
        for first in range(0, updates * size, size):
            part = slice(first, first + size)
            batch = self._batch(
                index[part], following[part], program[part], reward[part], discount[part]
            )
            if self._dropout and hidden is not None:
                scene = batch.objects, batch.next_objects, batch.program
                self._dropout.hide(hidden[part], *scene)
            yield batch

    def snapshot(self, version: int | None = None) -> PolicySnapshot:
        """Published weights: the newest, or one of the last policy_lag + 1 versions.

        Raises ActingError if that version is not kept any more, or not yet.
        """
        if version is None:
            return self.published[-1]
        for kept in self.published:
            if kept.version == version:
                return kept
        versions = [kept.version for kept in self.published]
        raise ActingError(f"policy: expected one of the versions {versions}, got {version}")

    def metrics(self) -> dict[str, float]:
        """Counters and the latest update's figures, by name."""
        return {
            "version": self.counters.version,
            "frames": self.counters.frames,
            "episodes": self.counters.episodes,
            "updates": self.counters.updates,
            "missing_trajectories": self.replay.ledger.missing,
            "lost_trajectories": self.replay.ledger.lost,
            "duplicate_trajectories": self.replay.ledger.duplicates,
            "too_old_trajectories": self.replay.ledger.too_old,
            **self.engine.metrics(),
        }

    def _row(self, program: Program) -> int:
        """Row of a program in the table; ProgramError or NetworkError if it has none."""
        family_of(self.network).check(program, self.network.vocabulary)
        return self.table.add(program)

    def _snapshot(self, version: int) -> PolicySnapshot:
        return PolicySnapshot(
            version=version,
            architecture=self.network.architecture,
            world_digest=self.network.world.digest,
            tensors={k: np.ascontiguousarray(v) for k, v in self.engine.actor_tensors().items()},
        )

    def _updates_due(self, frames: int) -> int:
        """Updates due for `frames` more transitions; fractions are carried over."""
        if self.counters.frames > self.config.replay.warmup_frames:
            self.counters.frames_due += frames
        total = self.counters.frames_due * self.config.updates.per_frame
        return math.floor(total + 1e-9) - self.counters.updates

    def _programs(self, index: Int64, following: Int64) -> tuple[Int32, Float32]:
        """Programs [B, K] and their rewards [B, K] for rows [B]."""
        arrays = self.replay.arrays
        program, reward = arrays["program"][index], arrays["reward"][index]
        if self._relabeler is None:
            program, reward = program[:, None], reward[:, None]
        else:
            rewards = arrays["goal_reward"][following] if self._relabeler.rewards_kept else None
            marks = Marks(arrays["satisfied"][following], arrays["present"][index], rewards)
            k = self.config.relabeling.programs_per_transition
            program, reward = self._relabeler.draw(self.rng, program, reward, marks, k)
        return np.ascontiguousarray(program), np.ascontiguousarray(reward)

    def _discount(self, index: Int64) -> Float32:
        terminal = self.replay.arrays["terminal"][index]
        return np.where(terminal, 0.0, self.config.updates.discount).astype(np.float32)

    def _hidden(self, rows: int) -> Float32 | None:
        """What decides on hidden properties, [rows, 2], if any are to be hidden."""
        return None if self._dropout is None else self.rng.random((rows, 2), np.float32)

    def _batch(
        self, index: Int64, following: Int64, program: Int32, reward: Float32, discount: Float32
    ) -> Batch:
        """Gather rows; `take` along axis 0 costs half of indexing for so few."""
        arrays = self.replay.arrays
        return Batch(
            objects=arrays["objects"].take(index, 0),
            arm=arrays["arm"].take(index, 0),
            action=arrays["action"].take(index, 0),
            next_objects=arrays["objects"].take(following, 0),
            next_arm=arrays["arm"].take(following, 0),
            program=program,
            reward=reward,
            discount=discount,
        )
