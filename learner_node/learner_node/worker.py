"""The learner on a thread of its own, so that messages are heard while it learns."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

from learner_node.config import LearnerNodeConfig
from pa_ros.core.errors import PaError
from pa_ros.core.experience import AgentKey
from pa_ros.core.published import PublishedPolicy
from pa_ros.learning.checkpoint_files import make_latest, newest_whole
from pa_ros.learning.checkpoints import restore, save_checkpoint
from pa_ros.learning.errors import CheckpointError, DivergedError, FolderTakenError
from pa_ros.learning.folder import checkpoint_of, claim
from pa_ros.learning.learner import Learner
from pa_ros.learning.run import LearningRun
from pa_ros.learning.turns import Turns
from pa_ros.provenance.origins import learner_origin
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.diagnostics import Origin
from pa_ros.world import Scoring, Trajectory, reward_from

DRAIN_S = 3.0  # their agents may be gone, and then nobody sends again what waits


@dataclass(frozen=True)
class Sinks:
    """Where a worker's results go; called on the worker's thread."""

    publish: Callable[[PublishedPolicy], None]
    refuse: Callable[[str, PaError], None]
    tell: Callable[[str], object]  # for the log


class LearnerWorker:
    """Consumes trajectories in the order they came, publishing a policy for each."""

    def __init__(self, config: LearnerNodeConfig, arena: ArenaDescription, sinks: Sinks) -> None:
        self.world = arena.world
        self.failure: BaseException | None = None  # a bug; the node must not go on
        self.diverged: DivergedError | None = None  # learning has stopped; the rest is refused
        self.unsaved: PaError | None = None  # why the latest checkpoint could not be written
        self.rejected = 0  # trajectories that could not be used
        self._config, self._arena, self._sinks = config, arena, sinks
        self._learner = _make_learner(config, arena)
        self._folder = self._claimed()
        extra = self._resumed() if config.resume else {}
        self.run = LearningRun(self._learner, arena.control_period, extra)
        self._started = time.monotonic() - float(extra.get("wall_s", 0.0))
        self.metrics = self._learner.metrics()
        self._frames_at_start = self.metrics["frames"]
        self._turns = Turns(self.run, config.turns)
        self._offered = deque[PublishedPolicy](maxlen=self._learner.config.schedule.versions_kept)
        self._trajectories: queue.SimpleQueue[Trajectory | None] = queue.SimpleQueue()
        self._stopping = False
        self._turn = threading.Lock()  # held while a trajectory is learned from, and at rest
        self._may_learn = threading.Event()
        self._may_learn.set()
        self._thread = threading.Thread(target=self._run, name="learner", daemon=True)

    @property
    def backlog(self) -> int:
        """Trajectories that wait; unless agents are free at most policy_lag + 1 of each."""
        return self._trajectories.qsize() + len(self._turns)

    @property
    def awaited(self) -> str:
        """The agent for whose trajectory others' wait; empty: there is none."""
        return self._turns.awaited

    @property
    def has_learned(self) -> bool:
        """Whether any trajectory was learned from since the start."""
        return self.metrics["frames"] > self._frames_at_start

    def suits(self, arena: ArenaDescription) -> bool:
        """Whether an arena is, but for its name and seed, the one that is learned about."""
        names = {"arena_id": "", "seed": 0, "stamp_ns": 0, "software_version": ""}
        return replace(arena, **names) == replace(self._arena, **names)  # type: ignore[arg-type]

    def missing(self, at_work: Callable[[AgentKey], bool]) -> int:
        """Trajectories skipped by agents that are at work, who may still send them."""
        accounts = list(self._learner.replay.ledger.accounts.items())
        return sum(
            one.missing for name, one in accounts if at_work(AgentKey(name, one.incarnation))
        )

    @property
    def trouble(self) -> str:
        """What a person has to see to, in words; empty: nothing."""
        if self.diverged is not None:
            return str(self.diverged)
        if self.unsaved is not None:
            return f"what is learned is not saved: {self.unsaved}"
        return ""

    @property
    def engine(self) -> str:
        """What makes the updates: "fused" or "torch"."""
        return self._learner.engine.name

    def origin(self, node: str) -> Origin:
        """The learner's account of itself; ask before `start`."""
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
        """Publish the versions that may still be asked for, oldest first; then learn."""
        for policy in self.run.opening():
            self._offer(policy)
        self._thread.start()

    def submit(self, trajectory: Trajectory) -> None:
        """Learn from a trajectory when its turn comes."""
        self._trajectories.put(trajectory)

    def rest(self) -> None:
        """Learn from nothing more, once the trajectory at hand is learned from; write a checkpoint.

        What waits goes on waiting.
        """
        self._may_learn.clear()
        self._turn.acquire()
        self._save_sound()

    def go_on(self) -> None:
        """Learn again, from what waits first."""
        if not self._may_learn.is_set():
            self._may_learn.set()
            self._turn.release()

    def close(self) -> None:
        """Take in what waits, as far as DRAIN_S allows, and write a checkpoint."""
        self.go_on()
        self._trajectories.put(None)
        if self._thread.is_alive():
            self._thread.join(DRAIN_S)
            self._stopping = True
            self._thread.join()
        self._save_sound()
        if self._folder is not None:
            self._folder.close()

    def discard(self) -> None:
        """Stop without a checkpoint: nothing was learned."""
        self._stopping = True
        self.go_on()
        self._trajectories.put(None)
        self._thread.join()
        if self._folder is not None:
            self._folder.close()

    def _run(self) -> None:
        try:
            while (trajectory := self._trajectories.get()) is not None and not self._stopping:
                self._may_learn.wait()  # so that who asks for rest gets it, however much waits
                with self._turn:
                    if not self._stopping:
                        self._take_in(trajectory)
        except BaseException as error:  # seen by the node's timer
            self.failure = error

    def _take_in(self, trajectory: Trajectory) -> None:
        if self.diverged is not None:
            self._reject(self.diverged)
            return
        try:
            for one in self._turns.ready(trajectory):
                self._consume(one)
        except DivergedError as error:
            self._stop_learning(error)
        except PaError as error:
            self._reject(error)

    def _stop_learning(self, error: DivergedError) -> None:
        """Whatever waits or comes from now on is refused."""
        self.diverged = error
        self._sinks.refuse("learning", error)
        waiting, self._turns = len(self._turns), Turns(self.run, self._config.turns)
        for _ in range(waiting):
            self._reject(error)

    def _reject(self, error: PaError) -> None:
        self.rejected += 1
        self._sinks.refuse("trajectories", error)

    def _consume(self, trajectory: Trajectory) -> None:
        before = self._learner.counters.frames
        refused = False
        try:
            self.run.consume(trajectory)
        except DivergedError:
            raise
        except PaError as error:
            self._reject(error)
            refused = True
        self.metrics = self._learner.metrics()
        if refused or self._turns.over:
            self._offer(self.run.policy())
        elif self._learner.counters.frames == before:  # its agent missed these, perhaps
            for policy in self._offered:
                self._sinks.publish(policy)
        every = self._config.checkpoint_every_frames
        if every and self._learner.counters.frames // every > before // every:
            self._save()

    def _offer(self, policy: PublishedPolicy) -> None:
        self._offered.append(policy)
        self._sinks.publish(policy)

    def _save_sound(self) -> None:
        """None is written of numbers that are not finite: of learning that diverged, the state
        before."""
        if self.failure is None and (self.diverged is None or self.diverged.restored):
            try:
                self._save()
            except DivergedError as error:
                self.diverged = error

    def _save(self) -> None:
        if not self._config.out:
            return
        arena = self._arena
        about = self._config.seed, arena.design, arena.preset, arena.arm
        extra = self.run.facts(self._started, *about)
        try:
            save_checkpoint(checkpoint_of(Path(self._config.out)), self._learner, extra)
            self.unsaved = None
            done = self._learner.counters
            self._sinks.tell(f"checkpoint: version {done.version} after {done.frames} frames")
        except DivergedError:
            raise
        except PaError as error:  # a full disk: the one before is still whole
            self.unsaved = error
            self._sinks.refuse("checkpoint", error)

    def _resumed(self) -> dict[str, Any]:
        """Go on from the newest whole checkpoint, and say so if another was damaged."""
        try:
            checkpoint, passed_over = newest_whole(checkpoint_of(Path(self._config.out)))
            if passed_over:
                self._sinks.refuse("checkpoint", CheckpointError(passed_over))
                make_latest(checkpoint)
            return restore(checkpoint, self._learner)
        except PaError:  # in another arena it may be gone on from
            if self._folder is not None:
                self._folder.close()
            raise

    def _claimed(self) -> IO[bytes] | None:
        """The folder, kept from other runs; None where nothing can be written, which is said."""
        config = self._config
        try:
            return claim(Path(config.out), config.resume) if config.out else None
        except FolderTakenError:
            raise
        except CheckpointError as error:
            self.unsaved = error
            return None


def _make_learner(config: LearnerNodeConfig, arena: ArenaDescription) -> Learner:
    settings = config.settings()
    network = settings.network_config(arena.world, config.network)
    reward = reward_from(arena.reward)
    scoring = Scoring.of(arena.world.relations, arena.thresholds, reward)
    programs, n_objects = arena.training_programs, arena.block_count + 1
    return Learner(network, settings.learner, programs, config.seed, scoring, n_objects)
