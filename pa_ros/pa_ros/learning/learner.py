"""The learner: replay buffer, updates in a fixed ratio to frames, and published weights."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.experience import Float32, PolicySnapshot
from pa_ros.core.extensions import guarded
from pa_ros.core.update import Batch, Engine
from pa_ros.language import Program
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.checkpoints import start_from
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.errors import DivergedError
from pa_ros.learning.replay_buffer.buffer import Int64, ReplayBuffer
from pa_ros.learning.rules.builder import make_rule
from pa_ros.learning.rules.rule import Int32
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import not_finite
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.programs import ProgramTable

LEARNER_STREAM = 2  # of default_rng([seed, stream])
# A critic that knows nothing would spoil an actor that a learner starts from, so for so many
# updates the critic learns alone.
CRITIC_FIRST = 4000
# If a trajectory is due at least so many updates, the state is saved before them, to return to it
# if they diverge, and all of it is checked afterwards. That costs about as much as one update.
SAVED_BEFORE = 80


@dataclass
class Counters:
    """A learner's counters; its checkpoint contains all of them."""

    version: int = 0  # trajectories accepted
    frames: int = 0  # transitions accepted
    episodes: int = 0
    updates: int = 0
    frames_due: int = 0  # transitions that updates are due for: all but the warm-up's


@dataclass(frozen=True)
class _Saved:
    """A learner's state before a trajectory, except its replay buffer."""

    counters: Counters
    rng: Mapping[str, Any]
    tensors: dict[str, NDArray[Any]]


class Learner:
    """Learns from trajectories and publishes policies; one seed and one order, one result.

    The learning rule draws from `training_programs`; programs of trajectories join the table as
    they arrive.
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
        """`config` names the algorithm; ConfigError if it is not registered, or for more than one
        program per transition where programs move objects.

        :param scoring: the arena's, by which relabeling computes rewards; None: the paper's reward
            at the relations' default thresholds.
        :param n_objects: objects of the arena's scenes, the hand included; None: as in the first
            trajectory.
        """
        self.network = network
        self.scoring = scoring or Scoring.of(network.vocabulary.relations)
        self.config = config
        self.counters = Counters()
        self.rng = np.random.default_rng([seed, LEARNER_STREAM])
        self.table = ProgramTable(network.vocabulary)
        self.rule = make_rule(network, config, training_programs, self.scoring, self.table)
        for program in (*training_programs, *self.rule.programs):
            self._row(program)
        self.replay = ReplayBuffer(
            config.replay.capacity_frames, network.world, n_objects, self.rule.columns
        )
        make_engine = ALGORITHMS[config.ALGORITHM].make_engine
        self.engine: Engine = make_engine(network, config, self.table, self.rng)
        self._given: dict[str, NDArray[Any]] = {}  # the actor, if it is a checkpoint's
        if config.starts_from:
            self._given = start_from(Path(config.starts_from), self)
        if attach := getattr(self.engine, "attach", None):
            attach(self)
        kept = config.schedule.versions_kept
        self.published: deque[PolicySnapshot] = deque([self._snapshot(0)], maxlen=kept)

    def consume(self, trajectory: Trajectory) -> bool:
        """Store a trajectory, make the updates it is due, and publish one version more.

        Returns whether it was new: a duplicate changes nothing. Raises LearningError or
        ProgramError, with nothing changed, for a trajectory that cannot be used. Raises
        DivergedError, with no new version, when numbers are not finite any more; if that says
        `restored`, the learner is as it was before the trajectory, except for its replay buffer,
        else it must not be used any more.
        """
        if not self.replay.ledger.is_new(trajectory.key):
            self.replay.ledger.duplicates += 1
            return False
        # The learner's door: from here on the trajectory is trusted.
        self.replay.check(trajectory)
        program = self._row(trajectory.program)
        self.replay.insert(trajectory, program, self.rule.describe(trajectory))
        before = replace(self.counters)
        self.counters.frames += len(trajectory)
        updates = self._count_due(len(trajectory))
        saved = None
        if updates >= SAVED_BEFORE:
            saved = _Saved(before, self.rng.bit_generator.state, self.engine.tensors())
        self.update(updates)
        if self._given and self.counters.updates < CRITIC_FIRST:
            self.engine.load_tensors(self.engine.tensors() | self._given)
        # Agents may act on these weights at once, so they are checked before they are published.
        newest = self._snapshot(self.counters.version + 1)
        self._check_finite(newest, saved)
        if trajectory.ends_episode:
            self.counters.episodes += 1
            self.engine.end_episode()
        self.counters.version = newest.version
        self.published.append(newest)
        return True

    def _check_finite(self, newest: PolicySnapshot, saved: _Saved | None) -> None:
        """Raise DivergedError unless the latest update and the actor are made of finite numbers."""
        figures = self.engine.metrics()
        wrong = [name for name, value in figures.items() if not math.isfinite(value)]
        wrong += [f"actor.{name}" for name in not_finite(newest.tensors)]
        if saved is not None and not wrong:  # a sum of finite float32 is a finite float64
            sums = {k: v.sum(dtype=np.float64) for k, v in self.engine.tensors().items()}
            wrong = [name for name, total in sums.items() if not np.isfinite(total)]
        if not wrong:
            return
        shown = ", ".join(f"{name} {value:g}" for name, value in figures.items())
        error = DivergedError(
            f"learner: expected finite numbers, got others in {', '.join(wrong)} at update "
            f"{self.counters.updates} ({shown}): learning stopped after version "
            f"{self.counters.version}, whose weights are the last good ones; smaller learning "
            "rates or rewards may help"
        )
        if saved is not None:
            self.counters, self.rng.bit_generator.state = saved.counters, saved.rng
            self.engine.load_tensors(saved.tensors)
            error.restored = True
        raise error

    def update(self, updates: int) -> None:
        """Make this many updates, whether due or not; LearningError without transitions."""
        update = guarded(f"algorithm {self.config.ALGORITHM}", self.engine.update)
        for batch in self.batches(updates):
            update(batch)
            self.counters.updates += 1

    def batches(self, updates: int) -> Iterator[Batch]:
        """Batches for this many updates.

        All rows are drawn at once, since the replay buffer does not change meanwhile, and one large
        draw is much cheaper than many small ones.
        """
        if updates == 0:
            return
        size = self.config.replay.batch_size
        drawn = self.rule.draw(self.rng, self.replay, updates * size)
        for first in range(0, updates * size, size):
            yield drawn.batch(slice(first, first + size))

    def rewards(self, rows: Int64, program: Int32) -> Float32:
        """Rewards [B, K] of the replay buffer's transitions `rows` [B], under programs [B, K] of a
        batch; LearningError if the rule cannot say them."""
        return self.rule.rewards(self.replay, rows, program)

    def snapshot(self) -> PolicySnapshot:
        """The newest published weights."""
        return self.published[-1]

    def metrics(self) -> dict[str, float]:
        """Counters and the latest update's figures, by name."""
        rewards = {"reward_per_step": self.replay.reward_per_step()} if self.replay.rows else {}
        return {
            "version": self.counters.version,
            "frames": self.counters.frames,
            "episodes": self.counters.episodes,
            "updates": self.counters.updates,
            "missing_trajectories": self.replay.ledger.missing,
            "lost_trajectories": self.replay.ledger.lost,
            "duplicate_trajectories": self.replay.ledger.duplicates,
            "rejected_trajectories": self.replay.ledger.rejected,
            **rewards,
            **self.engine.metrics(),
        }

    def _row(self, program: Program) -> int:
        """Row of a program in the table; ProgramError or NetworkError if it has none."""
        family_of(self.network).check(program, self.network.vocabulary)
        return self.table.add(program)

    def _snapshot(self, version: int) -> PolicySnapshot:
        tensors, share = self.engine.actor_tensors(), self.config.updates.published
        if share < 1 and version:
            mean = self.published[-1].tensors
            tensors = {k: mean[k] + np.float32(share) * (v - mean[k]) for k, v in tensors.items()}
        return PolicySnapshot(
            version=version,
            architecture=self.network.architecture,
            world_digest=self.network.world.digest,
            tensors=tensors,
        )

    def _count_due(self, frames: int) -> int:
        """Count `frames` more transitions; returns how many updates are due for them."""
        if self.counters.frames > self.config.replay.warmup_frames:
            self.counters.frames_due += frames
        # Counted from the beginning, so that fractions carry over. 1e-9 keeps a product such as
        # 0.29 × 100, which is 28.999…, from costing an update.
        total = self.counters.frames_due * self.config.updates.per_frame
        return math.floor(total + 1e-9) - self.counters.updates
