"""The learner as a ROS node: transitions in, policy weights out."""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from learner_node.config import LearnerNodeConfig
from learner_node.watch import Watch
from learner_node.worker import LearnerWorker, Sinks
from pa_ros.core.errors import PaError
from pa_ros.core.published import LearnerInfo, PublishedPolicy
from pa_ros.learning.checkpoint_files import newest_whole
from pa_ros.learning.errors import CheckpointError, FolderTakenError, LearningError
from pa_ros.learning.folder import checkpoint_of, refuse_used
from pa_ros.learning.progress import Scalars
from pa_ros.ros import topics
from pa_ros.ros.arenas import Arenas, OtherArenaError
from pa_ros.ros.authority import Authority
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, PROGRESS_S, WARN
from pa_ros.ros.learners import LEARNER_ID
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.listening import listening_clock
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.errors import WireError
from pa_ros.wire.learning import decode_trajectory, encode_learner_info, encode_weights
from pa_ros.wire.step import arena_of
from pa_ros.world import reward_from

WATCH_S = 0.5
OTHER_ARENA_S = 3.0  # for another arena, where the checkpoint is not of the one known of
EARLY_TRAJECTORIES = 1000  # kept until an arena describes itself


class EarlyTrajectoryError(PaError):
    """More experience than is kept while no arena has described itself."""

    code = "learner.early"


class Pace:
    """Frames and updates per second since it was asked last."""

    def __init__(self, metrics: Mapping[str, float] | None = None) -> None:
        """`metrics`: of a learner, as it begins."""
        self._at, self._then = time.monotonic(), metrics or {}

    def since_last(self, metrics: Mapping[str, float]) -> tuple[float, float]:
        elapsed = max(time.monotonic() - self._at, 1e-9)
        self._at, before, self._then = time.monotonic(), self._then, metrics
        frames, updates = (
            (metrics[name] - before.get(name, 0.0)) / elapsed for name in ("frames", "updates")
        )
        return frames, updates


class LearnerNode(ManagedNode):
    """One learner. An arena that describes itself says what is learned about: the first one, or,
    until something was learned, another one whose steps come."""

    config: LearnerNodeConfig

    def __init__(self) -> None:
        super().__init__("learner_node", LearnerNodeConfig)

    def configure(self) -> None:
        self._authority = Authority(self, self.config)
        self.worker: LearnerWorker | None = None
        if self.config.resume:
            newest_whole(checkpoint_of(Path(self.config.out)))
        elif self.config.out:
            refuse_used(Path(self.config.out))
        self._scalars: Scalars | None = None  # opened last: a file, and a thread that writes it
        self._failure: PaError | None = None  # why it can't learn about the arena that it knows of
        self._failed_at = 0.0
        self._arenas = Arenas(listening_clock(self))
        self._steps = list[Any]()  # subscriptions, until it has learned
        self._watch = Watch()
        self._early: list[Message] = []  # transitions that came before arena_info
        self._take = self.refusals.guard(topics.TRAJECTORIES.name, self._on_trajectory)
        self._health_pace = self._told_pace = Pace()
        self._instance = uuid.uuid4().hex
        self._weights = self._authority.publisher(topics.POLICY_WEIGHTS)
        self._announcement = self._authority.publisher(topics.LEARNER_INFO)
        self._provenance = topics.PROVENANCE.publisher(self)
        for arena in self.config.arenas or ("",):
            info = topics.ARENA_INFO.within(arena)
            on_arena = self._authority.checked(info, self._on_arena)
            info.subscribe(self, self.refusals.guard(info.name, on_arena))
            steps = topics.OBJECT_FEATURES.within(arena)
            self._steps.append(steps.subscribe(self, self._on_step))
        trajectories = topics.TRAJECTORIES
        on_trajectory = self._authority.checked(trajectories, self._on_trajectory)
        trajectories.subscribe(self, self.refusals.guard(trajectories.name, on_trajectory))
        steady_timer(self, WATCH_S, self._look)
        if self.config.tensorboard:
            self._scalars = Scalars(Path(self.config.tensorboard))
            steady_timer(self, PROGRESS_S, self.draw)

    def activate(self) -> None:
        """Go on, about the arena that was heard of meanwhile, should nothing be learned yet."""
        if self.worker is not None:
            self.worker.go_on()
        if self._arenas.current is not None:
            self.refusals.guard(topics.ARENA_INFO.name, self._belong)(self._arenas.current)

    def deactivate(self) -> None:
        """Finish the trajectory that is being learned from, and write a checkpoint."""
        if self.worker is not None:
            self.worker.rest()

    def cleanup(self) -> None:
        """Take in what waits, and write a last checkpoint."""
        if self.worker is not None:
            self.worker.close()
        self.draw()
        if self._scalars is not None:
            self._scalars.close()
            self._scalars = None
        if self.worker is not None and self.worker.trouble:
            self.get_logger().error(self.worker.trouble)
            self.exit_status = 1  # what was learned is not all saved
        self.worker = None

    def shutdown(self) -> None:
        self.active = False
        self.cleanup()  # which writes the checkpoint

    def alone(self) -> tuple[topics.Topic, str]:
        return topics.POLICY_WEIGHTS, self._instance

    @property
    def trouble(self) -> str:
        return "" if self.worker is None else self.worker.trouble

    def _on_arena(self, message: Message) -> None:
        arena = decode_arena_info(message)
        changed = self._arenas.announce(arena)
        if self.active and (self.worker is None or changed):
            self._belong(arena)
        if self.worker is not None:
            try:
                _check_facts(self.worker.run.info, arena)
            except PaError as error:
                self._watch.refused(f"an arena: {error}")
                raise

    def _on_step(self, message: Message) -> None:
        """Until something was learned: which arena is there, and not only said to be."""
        try:
            changed = self._arenas.step(arena_of(message))
        except OtherArenaError:  # of a fleet, perhaps
            return
        if changed and self.active and self._arenas.current is not None:
            self.refusals.guard(topics.ARENA_INFO.name, self._belong)(self._arenas.current)

    def _belong(self, arena: ArenaDescription) -> None:
        """Learn about an arena, unless the one that was learned about stands for it."""
        if self.worker is not None:
            if self.worker.has_learned or self.worker.suits(arena):
                return
            self.worker.discard()
            self.worker = None
        self._start(arena)

    def _start(self, arena: ArenaDescription) -> None:
        reward_from(arena.reward)  # an unknown one is refused, and another arena waited for
        sinks = Sinks(self._publish, self._refuse, self.get_logger().info)
        try:
            self.worker, self._failure = LearnerWorker(self.config, arena, sinks), None
        except PaError as error:  # a checkpoint of other settings, or a stranger's arena
            self._failure, self._failed_at = error, time.monotonic()
            raise
        origin = self.worker.origin(self.get_fully_qualified_name())
        self._provenance.publish(encode_provenance(origin))
        self._announcement.publish(encode_learner_info(self.worker.run.info))
        self.get_logger().info(
            f"run {self.worker.run.info.run_id}: design {arena.design}, arm {arena.arm}, "
            f"{arena.preset}, protocol {self.config.protocol}, {self.worker.engine} updates by "
            f"{self.config.algorithm}; "
            f"checkpoints in {self.config.out or 'none (parameter out)'}"
        )
        metrics = self.worker.metrics
        self._health_pace, self._told_pace = Pace(metrics), Pace(metrics)
        self.worker.start()
        early, self._early = self._early, []
        for message in early:
            self._take(message)

    def _on_trajectory(self, message: Message) -> None:
        if not self.active:
            return  # its agent keeps what isn't accounted for, and sends it again
        if self.worker is None:  # the arena's own description may come later than experience
            if len(self._early) == EARLY_TRAJECTORIES:
                raise EarlyTrajectoryError(
                    f"trajectories: expected arena_info first, got {EARLY_TRAJECTORIES} of them "
                    "without it, and keep no more"
                )
            self._early.append(message)
            return
        try:
            trajectory = decode_trajectory(message, self.worker.world)
        except PaError as error:
            self._watch.refused(f"trajectories: {error}")
            raise
        self._watch.came(trajectory.agent)
        self.worker.submit(trajectory)

    def _refuse(self, where: str, error: PaError) -> None:
        """What the worker refuses."""
        self.refusals.refuse(where, error)
        if where == topics.TRAJECTORIES.name:
            self._watch.refused(f"trajectories: {error}")

    def _publish(self, policy: PublishedPolicy) -> None:
        self._weights.publish(encode_weights(policy))

    def _look(self) -> None:
        if self.worker is None:
            used = isinstance(self._failure, FolderTakenError)
            waited_s = time.monotonic() - self._failed_at
            if isinstance(self._failure, CheckpointError) and (used or waited_s > OTHER_ARENA_S):
                self.ended_by = self._failure
            return
        if self.worker.failure is not None:
            raise self.worker.failure
        if self._steps and self.worker.has_learned:
            for subscription in self._steps:
                self.destroy_subscription(subscription)
            self._steps.clear()

    def collect(self) -> tuple[int, str, dict[str, str]]:
        worker = self.worker
        if worker is None and self._failure is not None:
            return ERROR, f"cannot learn about the arena that it hears: {self._failure}", {}
        if worker is None:
            return WARN, "waits for an arena (arena_info): does sim_node run in this domain?", {}
        metrics = worker.metrics
        frames_per_s, updates_per_s = self._health_pace.since_last(metrics)
        values = {
            "run_id": worker.run.info.run_id,
            LEARNER_ID: worker.run.info.learner_id,
            "engine": worker.engine,
            "backlog": str(worker.backlog),
            "rejected_trajectories": str(worker.rejected),
            "frames_per_s": f"{frames_per_s:.1f}",
            "updates_per_s": f"{updates_per_s:.1f}",
            **{name: f"{value:.6g}" for name, value in metrics.items()},
        }
        missing = worker.missing(self._watch.at_work)
        return *self._watch.state(
            worker.trouble, missing, worker.backlog, metrics["frames"], worker.awaited
        ), values

    def draw(self) -> None:
        """Write how learning goes for TensorBoard, as long as there is room."""
        if self._scalars is None or self.worker is None:
            return
        try:
            self._scalars.add(self.worker.metrics)
        except LearningError as error:
            self.refusals.refuse("tensorboard: nothing more is written", error)
            self._scalars.close()
            self._scalars = None

    def progress(self) -> str:
        """A line of how far it is; empty before the first frame."""
        worker = self.worker
        if worker is None or not worker.metrics["frames"]:
            return ""
        metrics = worker.metrics
        frames_per_s, updates_per_s = self._told_pace.since_last(metrics)
        loss = f", critic loss {metrics['critic_loss']:.5f}" if "critic_loss" in metrics else ""
        return (
            f"frames {metrics['frames']:,.0f} ({frames_per_s:.0f}/s), "
            f"updates {metrics['updates']:,.0f} ({updates_per_s:.0f}/s), "
            f"weights version {metrics['version']:.0f}{loss}"
        )


def _check_facts(learner: LearnerInfo, arena: ArenaDescription) -> None:
    """Raise a WireError unless an arena is one that the learner's experience may come from."""
    facts: list[tuple[str, object, object, str]] = [
        ("world_digest", learner.world_digest, arena.world.digest, "wire.world"),
        ("reward", learner.reward, arena.reward, "wire.reward"),
        ("control_period", learner.control_period, arena.control_period, "wire.arena_fact"),
        ("thresholds", learner.thresholds, arena.thresholds, "wire.arena_fact"),
    ]
    for name, ours, theirs, code in facts:
        if ours != theirs:
            raise WireError(f"arena_info.{name} of {arena.arena_id!r}", ours, theirs, code)
