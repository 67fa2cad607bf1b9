"""The learner: replay buffer, updates in a fixed ratio to frames, and published weights."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pa_ros.core.errors import ConfigError
from pa_ros.core.experience import Float32, PolicySnapshot
from pa_ros.core.update import Batch, Engine
from pa_ros.language import Program
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.config import LearnerConfig
from pa_ros.learning.errors import DivergedError, LearningError
from pa_ros.learning.hindsight import Hindsight
from pa_ros.learning.relabeling.all_goals import GoalMasks, Int32, Relabeler
from pa_ros.learning.relabeling.property_dropout import PropertyDropout
from pa_ros.learning.replay_buffer.buffer import NO_GOALS, Int64, ReplayBuffer
from pa_ros.networks.config import NetworkConfig
from pa_ros.networks.families import family_of
from pa_ros.networks.parameters import not_finite
from pa_ros.world import Scoring, Trajectory
from pa_ros.world.poses import POSE_WIDTH
from pa_ros.world.programs import ProgramTable

LEARNER_STREAM = 2  # of default_rng([seed, stream])
# If a trajectory is due at least so many updates, the state is saved before them, to return to it
# if they diverge, and all of it is checked afterwards. That costs about as much as one update.
SAVED_BEFORE = 80
# Value of a violated program, as a share of that of never being rewarded. At 1 agents keep so far
# away from what they avoid that they don't reach targets beside it.
VIOLATED = 0.5


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

    Relabeling draws from `training_programs`; programs of trajectories join the table as they
    arrive.
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
        for program in training_programs:
            self._row(program)
        self._relabeler, self._hindsight = None, None
        if config.relabeling.rule == "all-goals":
            asked = training_programs, network.world, self.scoring
            words, count = network.vocabulary, config.relabeling.programs_per_transition
            if (words.moves_objects or words.avoids) and count > 1:
                raise ConfigError(
                    "learner.relabeling.programs_per_transition: expected 1 where programs "
                    f"move objects or avoid them, got {count}"
                )
            if words.moves_objects:
                self._hindsight = Hindsight(*asked, config.hindsight)
                for program in self._hindsight.programs:
                    self._row(program)
            else:
                self._relabeler = Relabeler(*asked)
                for program in self._relabeler.programs:
                    self._row(program)
        self._dropout = None
        if config.relabeling.property_dropout and not (
            network.world.schema.tells_words or self._relabeler
        ):
            raise ConfigError(
                "learner.relabeling.property_dropout: expected 0 without relabeling where "
                "properties are seen, since it is not known which objects a program names, got "
                f"{config.relabeling.property_dropout}"
            )
        if config.relabeling.property_dropout and family_of(network).evaluates_programs:
            self._dropout = PropertyDropout(
                self.table, network.world, config.relabeling.property_dropout
            )
        goals = self._relabeler.rewards_kept if self._relabeler else 0
        self.replay = ReplayBuffer(config.replay.capacity_frames, network.world, n_objects, goals)
        make_engine = ALGORITHMS[config.ALGORITHM].make_engine
        self.engine: Engine = make_engine(network, config, self.table, self.rng)
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
        goals = NO_GOALS
        if self._relabeler is not None:
            seen, hand_pose = trajectory.objects, trajectory.arm[:, -POSE_WIDTH:]
            goals = self._relabeler.masks(
                seen, trajectory.hand_index, hand_pose, trajectory.measures
            )
        elif self._hindsight is not None:
            goals = self._hindsight.masks(trajectory)
        self.replay.insert(trajectory, program, goals)
        before = replace(self.counters)
        self.counters.frames += len(trajectory)
        updates = self._updates_due(len(trajectory))
        saved = None
        if updates >= SAVED_BEFORE:
            saved = _Saved(before, self.rng.bit_generator.state, self.engine.tensors())
        self.update(updates)
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
        for batch in self.batches(updates):
            self.engine.update(batch)
            self.counters.updates += 1

    def batches(self, updates: int) -> Iterator[Batch]:
        """Batches for this many updates.

        All rows are drawn at once, since the replay buffer does not change meanwhile, and one large
        draw is much cheaper than many small ones.
        """
        size = self.config.replay.batch_size
        if updates == 0:
            return
        drawn = None
        if self._hindsight is not None:
            drawn = self._hindsight.draw(self.rng, self.replay, updates * size)
            index, program, reward = drawn.index, drawn.program[:, None], drawn.reward[:, None]
        else:
            index = self.replay.sample(self.rng, updates * size)
            program, reward = self._programs(index, self.replay.following(index))
        following = self.replay.following(index)
        # An episode that was cut off by its time limit is not terminal: what would have followed
        # still has a value.
        terminal = self.replay.arrays["terminal"][index]
        discount = np.where(terminal, 0.0, self.config.updates.discount).astype(np.float32)
        if self.network.vocabulary.avoids and self._relabeler is not None:
            # A violated program cannot hold any more, so nothing is bootstrapped.
            masks = self._masks(index, following)
            lost = self._relabeler.violated(program, masks)[:, 0]
            discount[lost] = 0.0
            never = self._relabeler.worst / (1.0 - self.config.updates.discount)
            reward = np.where(lost[:, None], np.float32(VIOLATED * never), reward)
        # These numbers decide which properties of which block are hidden, [rows, 2].
        hidden = None if self._dropout is None else self.rng.random((len(index), 2), np.float32)
        for first in range(0, updates * size, size):
            part = slice(first, first + size)
            rows = index[part], following[part]
            objects, arm, next_objects, next_arm = (
                self._scenes(*rows) if drawn is None else drawn.scenes(part)
            )
            if self._dropout and hidden is not None:
                may_name = self.replay.may_name(rows[0])
                self._dropout.hide(hidden[part], objects, next_objects, program[part], may_name)
            yield Batch(
                objects=objects,
                arm=arm,
                action=self.replay.arrays["action"].take(rows[0], 0),
                next_objects=next_objects,
                next_arm=next_arm,
                program=program[part],
                reward=reward[part],
                discount=discount[part],
                rows=rows[0],
            )

    def rewards(self, rows: Int64, program: Int32) -> Float32:
        """Rewards [B, K] of the replay buffer's transitions `rows` [B], under programs [B, K] of a
        batch.

        Raises LearningError where programs move objects: hindsight moves the places of a
        transition, and its reward is true of that alone.
        """
        if self._hindsight is not None:
            raise LearningError("rewards: expected programs that move the hand alone")
        following = self.replay.following(rows)
        own = np.repeat(self.replay.arrays["reward"][rows, None], program.shape[1], 1)
        if self._relabeler is None:
            return own
        acted = program == self.replay.arrays["program"][rows, None]
        return np.where(acted, own, self._relabeler.rewards(program, self._masks(rows, following)))

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
        return PolicySnapshot(
            version=version,
            architecture=self.network.architecture,
            world_digest=self.network.world.digest,
            tensors=self.engine.actor_tensors(),
        )

    def _updates_due(self, frames: int) -> int:
        """Updates due for `frames` more transitions; fractions are carried over."""
        if self.counters.frames > self.config.replay.warmup_frames:
            self.counters.frames_due += frames
        # Counted from the beginning, so that fractions carry over. 1e-9 keeps a product such as
        # 0.29 × 100, which is 28.999…, from costing an update.
        total = self.counters.frames_due * self.config.updates.per_frame
        return math.floor(total + 1e-9) - self.counters.updates

    def _programs(self, index: Int64, following: Int64) -> tuple[Int32, Float32]:
        """Programs [B, K] and their rewards [B, K] for rows [B]."""
        arrays = self.replay.arrays
        program, reward = arrays["program"][index], arrays["reward"][index]
        if self._relabeler is None:
            program, reward = program[:, None], reward[:, None]
        else:
            masks = self._masks(index, following)
            k = self.config.relabeling.programs_per_transition
            program, reward = self._relabeler.draw(self.rng, program, reward, masks, k)
        return np.ascontiguousarray(program), np.ascontiguousarray(reward)

    def _masks(self, index: Int64, following: Int64) -> GoalMasks:
        """The stored masks: a transition is rewarded for the state that it leads to."""
        arrays = self.replay.arrays
        rewards = arrays["goal_reward"][following] if "goal_reward" in arrays else None
        return GoalMasks(arrays["satisfied"][following], arrays["present"][index], rewards)

    def _scenes(self, index: Int64, following: Int64) -> tuple[Float32, Float32, Float32, Float32]:
        """Objects and arm of rows, and of those that follow them. For so few rows `take` costs half
        of what indexing costs."""
        objects, arm = self.replay.arrays["objects"], self.replay.arrays["arm"]
        before = objects.take(index, 0), arm.take(index, 0)
        after = objects.take(following, 0), arm.take(following, 0)
        return *before, *after
