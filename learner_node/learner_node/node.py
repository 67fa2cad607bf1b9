"""The learner as a ROS node: trajectories in, policy weights out."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from learner_node.config import LearnerNodeConfig
from learner_node.status import LearnerStatus
from learner_node.worker import LearnerWorker, Sinks
from pa_ros.core.errors import PaError
from pa_ros.core.experience import LearnerInfo, PublishedPolicy
from pa_ros.learning.checkpoint_files import newest_whole
from pa_ros.learning.errors import CheckpointError, LearningError
from pa_ros.learning.folder import checkpoint_of, refuse_used
from pa_ros.learning.progress import Scalars
from pa_ros.learning.recipes import recipe_for
from pa_ros.ros import topics
from pa_ros.ros.executor import steady_timer
from pa_ros.ros.health import ERROR, LEARNER_ID, PROGRESS_S, WARN
from pa_ros.ros.lifecycle import ManagedNode
from pa_ros.ros.peers import PeerMonitor
from pa_ros.wire import Message, WireError
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.learning import decode_trajectory, encode_learner_info, encode_weights
from pa_ros.wire.step import arena_of

CHECK_S = 0.5  # between two checks of the worker
EARLY_TRAJECTORIES = 1000  # kept until an arena describes itself


class LearnerNode(ManagedNode):
    """Learns about the arena that it follows.

    Once it has learned from a trajectory, it can't learn about another arena any more, and refuses
    descriptions of arenas that differ.
    """

    config: LearnerNodeConfig

    def __init__(self) -> None:
        super().__init__("learner_node", LearnerNodeConfig)

    def configure(self) -> None:
        config = self.config
        if config.resume:
            newest_whole(checkpoint_of(Path(config.out)))
        elif config.out:
            refuse_used(Path(config.out))
        self.worker: LearnerWorker | None = None
        self._early: list[Message] = []  # trajectories that arrived before arena_info
        self._failure: PaError | None = None  # why it can't learn about the followed arena
        self._status = LearnerStatus()
        self._weights_out = self.advertise(topics.POLICY_WEIGHTS)
        self._info_out = self.advertise(topics.LEARNER_INFO)
        self._provenance_out = self.advertise(topics.PROVENANCE)
        self._arenas: list[PeerMonitor[ArenaDescription]] = []
        self._steps: list[Any] = []  # subscriptions
        for namespace in config.arenas or ("",):
            arenas = PeerMonitor("arena", self._learn_about)
            info, steps = (t.within(namespace) for t in (topics.ARENA_INFO, topics.OBJECT_FEATURES))
            self.subscribe(info, partial(self._on_arena, arenas))
            self._steps.append(self.subscribe(steps, partial(self._on_step, arenas)))
            self._arenas.append(arenas)
        self.subscribe(topics.TRAJECTORIES, self._on_trajectory)
        steady_timer(self, CHECK_S, self._check_worker)
        # Scalars come last: they open a file and start a thread, which a failure would leave.
        self._scalars = Scalars(Path(config.tensorboard)) if config.tensorboard else None
        if self._scalars is not None:
            steady_timer(self, PROGRESS_S, self.draw)

    def activate(self) -> None:
        if self.worker is not None:
            self.worker.resume()
        learn_about = self.refusals.guard(topics.ARENA_INFO.name, self._learn_about)
        for arenas in self._arenas:
            if arenas.current is not None:
                learn_about(arenas.current)

    def deactivate(self) -> None:
        if self.worker is not None:
            self.worker.pause()

    def cleanup(self) -> None:
        if self.worker is not None:
            self.worker.close()
        self.draw()
        if self._scalars is not None:
            self._scalars.close()
            self._scalars = None
        if self.worker is not None and self.worker.trouble:
            self.get_logger().error(self.worker.trouble)
            self.exit_status = 1  # not everything that was learned is saved
        self.worker = None

    def shutdown(self) -> None:
        self.active = False
        self.cleanup()  # without `deactivate`, which would write the checkpoint twice

    @property
    def trouble(self) -> str:
        return "" if self.worker is None else self.worker.trouble

    # Arenas

    def _on_arena(self, arenas: PeerMonitor[ArenaDescription], message: Message) -> None:
        arena = decode_arena_info(message)
        if self.worker is not None and self.worker.has_learned:
            self._check_facts(self.worker.run.info, arena)
        else:
            arenas.described(arena.arena_id, arena)

    def _on_step(self, arenas: PeerMonitor[ArenaDescription], message: Message) -> None:
        arenas.received(arena_of(message))

    def _learn_about(self, arena: ArenaDescription) -> None:
        """Start to learn about an arena, unless something was learned about another one already.

        Raises PaError for an arena that can't be learned about.
        """
        if not self.active:
            return
        if self.worker is not None:
            if self.worker.has_learned or self.worker.suits(arena):
                return
            self.worker.close(save=False)
            self.worker = None
        try:
            self.config = self._own_parameters.fix_again(recipe=recipe_for(arena.world.vocabulary))
            sinks = Sinks(self._publish, self._refuse, self.get_logger().info)
            self.worker, self._failure = LearnerWorker(self.config, arena, sinks), None
        except PaError as error:
            self._failure = error
            if isinstance(error, CheckpointError):  # waiting for another arena would not help
                self.ended_by = error
            raise
        self._announce(self.worker, arena)
        self.worker.start()
        early, self._early = self._early, []
        on_trajectory = self.refusals.guard(topics.TRAJECTORIES.name, self._on_trajectory)
        for message in early:
            on_trajectory(message)

    def _announce(self, worker: LearnerWorker, arena: ArenaDescription) -> None:
        origin = worker.origin(self.get_fully_qualified_name())
        self._provenance_out.publish(encode_provenance(origin))
        self._info_out.publish(encode_learner_info(worker.run.info))
        self._rates = RateMeter(worker.metrics)
        self.get_logger().info(
            f"run {worker.run.info.run_id}: design {arena.design}, arm {arena.arm}, "
            f"{arena.preset}, recipe {self.config.recipe}, {worker.engine} updates by "
            f"{self.config.algorithm}; checkpoints in {self.config.out or 'none (parameter out)'}"
        )

    def _check_facts(self, learner: LearnerInfo, arena: ArenaDescription) -> None:
        """Raise a WireError if experience in this arena would be of something else."""
        facts: list[tuple[str, object, object, str]] = [
            ("world_digest", learner.world_digest, arena.world.digest, "wire.world"),
            ("reward", learner.reward, arena.reward, "wire.reward"),
            ("control_period", learner.control_period, arena.control_period, "wire.arena_fact"),
            ("thresholds", learner.thresholds, arena.thresholds, "wire.arena_fact"),
        ]
        for name, ours, theirs, code in facts:
            if ours != theirs:
                error = WireError(
                    f"arena_info.{name} of {arena.arena_id!r}", ours, theirs, code=code
                )
                self._status.refused(f"an arena: {error}", ERROR)
                raise error

    # Experience in, weights out

    def _on_trajectory(self, message: Message) -> None:
        if not self.active:
            return  # its agent keeps a trajectory until weights account for it, and sends it again
        if self.worker is None:
            # A bag that is played sends nothing again, and its arena_info may come later.
            if len(self._early) == EARLY_TRAJECTORIES:
                raise LearningError(
                    f"trajectories: expected arena_info before more than {EARLY_TRAJECTORIES} of "
                    "them; does sim_node run?",
                    code="learner.early",
                )
            self._early.append(message)
            return
        try:
            trajectory = decode_trajectory(message, self.worker.world)
        except PaError as error:
            self._status.refused(f"trajectories: {error}")
            raise
        self._status.arrived(trajectory.agent_id)
        self.worker.submit(trajectory)

    def _publish(self, policy: PublishedPolicy) -> None:
        self._weights_out.publish(encode_weights(policy))

    def _refuse(self, where: str, error: PaError) -> None:
        self.refusals.refuse(where, error)
        if where == topics.TRAJECTORIES.name:
            self._status.refused(f"trajectories: {error}")

    def _check_worker(self) -> None:
        if self.worker is None:
            return
        if self.worker.failure is not None:
            raise self.worker.failure
        if self._steps and self.worker.has_learned:
            # From now on no other arena can be learned about: save the cost of every step.
            for subscription in self._steps:
                self.destroy_subscription(subscription)
            self._steps.clear()

    # Health

    def collect(self) -> tuple[int, str, dict[str, str]]:
        worker = self.worker
        if worker is None and self._failure is not None:
            return ERROR, f"cannot learn about the arena: {self._failure}", {}
        if worker is None:
            return WARN, "waits for an arena (arena_info): does sim_node run in this domain?", {}
        metrics = worker.metrics
        self._rates.update(metrics)
        values = {
            "run_id": worker.run.info.run_id,
            LEARNER_ID: worker.run.info.learner_id,
            "engine": worker.engine,
            "backlog": str(worker.backlog),
            "frames_per_s": f"{self._rates.frames_per_s:.1f}",
            "updates_per_s": f"{self._rates.updates_per_s:.1f}",
            **{name: f"{value:.6g}" for name, value in metrics.items()},
        }
        faults = [arenas.fault for arenas in self._arenas if arenas.fault]
        if faults and self._steps and not worker.trouble:
            return ERROR, faults[0], values
        missing = worker.missing(self._status.at_work)
        level, message = self._status.state(
            worker.trouble, missing, worker.backlog, metrics["frames"], worker.awaited
        )
        return level, message, values

    def draw(self) -> None:
        """Write the metrics for TensorBoard, until the disk is full."""
        if self._scalars is None or self.worker is None:
            return
        try:
            self._scalars.add(self.worker.metrics)
        except LearningError as error:
            self.refusals.refuse("tensorboard: nothing more is written", error)
            self._scalars.close()
            self._scalars = None

    def progress(self) -> str:
        worker = self.worker
        if worker is None or not worker.metrics["frames"]:
            return ""
        metrics, rates = worker.metrics, self._rates
        warmup = f"the first after {self.config.learner.replay.warmup_frames:,} frames"
        pace = f"{rates.updates_per_s:.0f}/s" if metrics["updates"] else warmup
        reward = metrics.get("reward_per_step")
        seen = "" if reward is None else f", reward/step {reward:+.3f}"
        loss = f", critic loss {metrics['critic_loss']:.5f}" if "critic_loss" in metrics else ""
        return (
            f"frames {metrics['frames']:,.0f} ({rates.frames_per_s:.0f}/s), "
            f"updates {metrics['updates']:,.0f} ({pace}), "
            f"weights version {metrics['version']:.0f}{seen}{loss}"
        )


class RateMeter:
    """Frames and updates per second, between the last two calls of `update`."""

    def __init__(self, metrics: Mapping[str, float]) -> None:
        self.frames_per_s = self.updates_per_s = 0.0
        self._at, self._before = time.monotonic(), dict(metrics)

    def update(self, metrics: Mapping[str, float]) -> None:
        """Measure since the call before."""
        elapsed_s = max(time.monotonic() - self._at, 1e-9)
        self.frames_per_s, self.updates_per_s = (
            (metrics[name] - self._before[name]) / elapsed_s for name in ("frames", "updates")
        )
        self._at, self._before = time.monotonic(), dict(metrics)
