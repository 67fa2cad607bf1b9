"""The learner on its own thread, so that the node can receive messages while it learns."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from learner_node.config import LearnerNodeConfig
from pa_ros.core.errors import PaError
from pa_ros.core.experience import PublishedPolicy
from pa_ros.learning.checkpoint_files import make_latest, newest_whole
from pa_ros.learning.checkpoints import restore, save_checkpoint
from pa_ros.learning.errors import CheckpointError, DivergedError
from pa_ros.learning.fixed_order import FixedOrder
from pa_ros.learning.folder import checkpoint_of, claim
from pa_ros.learning.learner import Learner
from pa_ros.learning.run import LearningRun
from pa_ros.provenance import learner_origin
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.diagnostics import Origin
from pa_ros.world import Scoring, Trajectory, reward_from

DRAIN_S = 3.0  # how long closing may take to learn from the trajectories that wait


@dataclass(frozen=True)
class Sinks:
    """The receiver of a worker's results; called on the worker's thread."""

    publish: Callable[[PublishedPolicy], None]
    refuse: Callable[[str, PaError], None]
    log: Callable[[str], object]


class LearnerWorker:
    """Learns from trajectories in the order of their arrival; publishes a policy for each."""

    def __init__(self, config: LearnerNodeConfig, arena: ArenaDescription, sinks: Sinks) -> None:
        """Raises PaError for a folder or checkpoint that can't be used with this arena."""
        self.world = arena.world
        self.failure: BaseException | None = None  # a bug: the node must end
        self.diverged: DivergedError | None = None  # learning has stopped
        self.unsaved: PaError | None = None  # why the newest checkpoint could not be written
        self._config, self._arena, self._sinks = config, arena, sinks
        self._learner = _make_learner(config, arena)
        # The lock keeps other runs out of the folder.
        self._folder = claim(Path(config.out), config.resume) if config.out else None
        extra = self._restore() if config.resume else {}
        self.run = LearningRun(self._learner, arena.control_period, extra)
        self._started = time.monotonic() - float(extra.get("wall_s", 0.0))
        self.metrics = self._learner.metrics()
        self._frames_at_start = self.metrics["frames"]
        self._order = FixedOrder(self.run, config.turns)
        self._offered = deque[PublishedPolicy](maxlen=self._learner.config.schedule.versions_kept)
        self._trajectories: queue.SimpleQueue[Trajectory | None] = queue.SimpleQueue()
        self._stopping = False
        self._learning = threading.Lock()  # held while a trajectory is learned from, and paused
        self._may_learn = threading.Event()
        self._may_learn.set()
        self._thread = threading.Thread(target=self._run, name="learner", daemon=True)

    @property
    def backlog(self) -> int:
        """Number of trajectories that wait."""
        return self._trajectories.qsize() + len(self._order)

    @property
    def awaited(self) -> str:
        """The agent whose turn it is while trajectories of others wait; empty if none wait."""
        return self._order.awaited

    @property
    def has_learned(self) -> bool:
        """Whether any trajectory was learned from since the start."""
        return self.metrics["frames"] > self._frames_at_start

    def suits(self, arena: ArenaDescription) -> bool:
        """Whether an arena equals the one that is learned about, but for its name and seed."""
        names = {"arena_id": "", "seed": 0, "stamp_ns": 0, "software_version": ""}
        return replace(arena, **names) == replace(self._arena, **names)  # type: ignore[arg-type]

    def missing(self, at_work: Callable[[str], bool]) -> int:
        """Number of skipped trajectories whose agents are at work, and can still send them."""
        return self._learner.replay.ledger.missing_of(at_work)

    @property
    def trouble(self) -> str:
        """An error that a person has to see to; empty for none."""
        if self.diverged is not None:
            return str(self.diverged)
        if self.unsaved is not None:
            return f"what is learned is not saved: {self.unsaved}"
        return ""

    @property
    def engine(self) -> str:
        """What computes the updates: "fused" or "torch"."""
        return self._learner.engine.name

    def origin(self, node: str) -> Origin:
        """The provenance of the learner; call before `start`."""
        return learner_origin(
            node,
            self.run.info.run_id,
            self._config.seed,
            self._learner,
            self._arena.training_programs,
            parameters=self._config.flat(),
            design=self._arena.design,
            arm=self._arena.arm,
            preset=self._arena.preset,
        )

    def start(self) -> None:
        """Publish the versions that agents may still need, oldest first; then learn."""
        for policy in self.run.opening():
            self._publish(policy)
        self._thread.start()

    def submit(self, trajectory: Trajectory) -> None:
        """Learn from a trajectory, after those submitted before."""
        self._trajectories.put(trajectory)

    def pause(self) -> None:
        """Finish the trajectory that is being learned from, write a checkpoint, and wait."""
        self._may_learn.clear()
        self._learning.acquire()
        self._save_if_sound()

    def resume(self) -> None:
        """Learn again after `pause`; trajectories that waited come first."""
        if not self._may_learn.is_set():
            self._may_learn.set()
            self._learning.release()

    def close(self, save: bool = True) -> None:
        """End; with `save`, learn from what waits for at most DRAIN_S and write a checkpoint.

        The agents of these trajectories may have ended, and could not send them again.
        """
        self._stopping = not save
        self.resume()
        self._trajectories.put(None)
        if self._thread.is_alive():
            self._thread.join(DRAIN_S)
            self._stopping = True
            self._thread.join()
        if save:
            self._save_if_sound()
        if self._folder is not None:
            self._folder.close()

    # On the worker's thread

    def _run(self) -> None:
        try:
            while (trajectory := self._trajectories.get()) is not None and not self._stopping:
                self._may_learn.wait()  # else this thread could take the lock before `pause` does
                with self._learning:
                    if not self._stopping:
                        self._learn_in_turn(trajectory)
        except BaseException as error:  # the node's timer raises it again
            self.failure = error

    def _learn_in_turn(self, trajectory: Trajectory) -> None:
        """Learn from a trajectory, or keep it until it is its agent's turn."""
        if self.diverged is not None:
            self._sinks.refuse("trajectories", self.diverged)
            return
        try:
            for ready in self._order.ready(trajectory):
                self._learn(ready)
        except DivergedError as error:
            self.diverged = error
            self._sinks.refuse("learning", error)
            waiting, self._order = len(self._order), FixedOrder(self.run, self._config.turns)
            for _ in range(waiting):
                self._sinks.refuse("trajectories", error)
        except PaError as error:
            self._sinks.refuse("trajectories", error)
            # Its agent may wait for an answer; in a fixed order weights are published once a round.
            if not self._config.turns:
                self._publish(self.run.policy())

    def _learn(self, trajectory: Trajectory) -> None:
        """Learn from a trajectory, publish the answer, and write a checkpoint if it is time."""
        before = self._learner.counters.frames
        refused = False
        try:
            self.run.consume(trajectory)
        except DivergedError:
            raise
        except PaError as error:
            self._sinks.refuse("trajectories", error)
            refused = True
        self.metrics = self._learner.metrics()
        frames, every = self._learner.counters.frames, self._config.checkpoint_every_frames
        if refused or self._order.round_complete:
            self._publish(self.run.policy())
        elif frames == before:  # a duplicate: perhaps its agent missed the newest versions
            for policy in self._offered:
                self._sinks.publish(policy)
        if every and frames // every > before // every:
            self._save()

    def _publish(self, policy: PublishedPolicy) -> None:
        self._offered.append(policy)
        self._sinks.publish(policy)

    # Folder and checkpoints

    def _save_if_sound(self) -> None:
        """Write a checkpoint, unless a bug or divergence left numbers that are not finite."""
        if self.failure is None and (self.diverged is None or self.diverged.restored):
            try:
                self._save()
            except DivergedError as error:
                self.diverged = error

    def _save(self) -> None:
        if not self._config.out:
            return
        arena = self._arena
        about = {"design": arena.design, "preset": arena.preset, "arm": arena.arm}
        about |= {"perception": arena.perception} if arena.perception else {}
        extra = self.run.facts(self._started, self._config.seed, **about)
        try:
            save_checkpoint(checkpoint_of(Path(self._config.out)), self._learner, extra)
        except DivergedError:
            raise
        except PaError as error:  # such as a full disk; the checkpoint before is still whole
            self.unsaved = error
            self._sinks.refuse("checkpoint", error)
            return
        self.unsaved = None
        done = self._learner.counters
        self._sinks.log(f"checkpoint: version {done.version} after {done.frames} frames")

    def _restore(self) -> dict[str, Any]:
        """Load the newest whole checkpoint; report one that is damaged."""
        try:
            checkpoint, passed_over = newest_whole(checkpoint_of(Path(self._config.out)))
            if passed_over:
                self._sinks.refuse("checkpoint", CheckpointError(passed_over))
                make_latest(checkpoint)
            return restore(checkpoint, self._learner)
        except PaError:  # another arena may suit the checkpoint: it needs the folder then
            if self._folder is not None:
                self._folder.close()
            raise


def _make_learner(config: LearnerNodeConfig, arena: ArenaDescription) -> Learner:
    network = config.network.for_world(arena.world)
    reward = reward_from(arena.reward)
    scoring = Scoring.of(arena.world.relations, arena.thresholds, reward)
    programs, n_objects = arena.training_programs, arena.block_count + 1
    return Learner(network, config.learner, programs, config.seed, scoring, n_objects)
