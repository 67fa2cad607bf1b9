"""Records a run in one process: the messages that a graph would have published."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pa_ros.arena import ArenaConfig, Design
from pa_ros.bags.errors import BagFullError
from pa_ros.bags.format import reliable_qos, topic
from pa_ros.bags.writer import BagWriter, refuse_existing
from pa_ros.core.clock import now_ns
from pa_ros.core.experience import PublishedPolicy
from pa_ros.language import Program
from pa_ros.learning.run import LearningRun
from pa_ros.provenance import learner_origin
from pa_ros.provenance.arena import describe
from pa_ros.wire import Message
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.definitions import installed_types, to_cdr
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.learning import encode_learner_info, encode_trajectory, encode_weights
from pa_ros.world import Trajectory

log = logging.getLogger(__name__)

NODE: Final = "/pa_ros_train"
WEIGHTS_EVERY_FRAMES: Final = 100  # at most; a version per frame would be 26 MB/s
FLUSH_S: Final = 1.0  # at most so much is lost by a SIGKILL
_TOPICS = (
    ("/provenance", "Provenance", reliable_qos(1, latched=True)),
    ("/arena_info", "ArenaInfo", reliable_qos(1, latched=True)),
    ("/learner_info", "LearnerInfo", reliable_qos(1, latched=True)),
    ("/trajectories", "Trajectory", reliable_qos(1, keep_all=True)),
    ("/policy_weights", "PolicyWeights", reliable_qos(4, latched=True)),
)


class RunLog:
    """A `pa_ros.learning.interfaces.Log` that writes a bag; a context manager that closes it.

    The bag is created when the run begins, so a run with wrong settings leaves none. If the disk is
    full, the bag is closed and `failure` is set; the run continues without being recorded.
    """

    def __init__(
        self,
        folder: Path,
        arena: ArenaConfig,
        design: Design,
        seed: int,
        training_programs: Sequence[Program],
        parameters: dict[str, Any],
        perception: str = "",
    ) -> None:
        """`parameters`: options of the run, plain JSON. `perception`: that of `train_agent`.

        Raises BagError if `folder` exists.
        """
        self.failure: BagFullError | None = None
        self._arena, self._design, self._seed = arena, design, seed
        self._programs, self._parameters = training_programs, parameters
        self._perception = perception
        self._types = installed_types()
        refuse_existing(folder)
        self._folder = folder
        self._writer: BagWriter | None = None
        self._stamp_ns = 0
        self._flushed = time.monotonic()
        self._frames = 0  # since the newest weights written

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._guarded(self._writer.close)

    def begin(self, run: LearningRun) -> None:
        """Write what the run is, and the weights it begins with. Raises BagError."""
        self._writer = writer = BagWriter(self._folder)
        for name, kind, qos in _TOPICS:
            writer.add(topic(self._types, name, f"msgs_schema/msg/{kind}", [qos]))
        learner, run_id = run.learner, run.info.run_id
        about = learner_origin(
            NODE,
            run_id,
            self._seed,
            learner,
            self._programs,
            parameters=self._parameters,
            design=self._design.name,
            arm=self._arena.arm,
            preset=self._arena.preset,
        )
        about_arena = self._arena, self._design, self._seed, self._programs, run_id
        arena = replace(
            describe(*about_arena, reward=learner.scoring.reward),
            world=learner.network.world,
            perception=self._perception,
        )
        self._write("/provenance", encode_provenance(about))
        self._write("/arena_info", encode_arena_info(arena))
        self._write("/learner_info", encode_learner_info(run.info))
        self._write("/policy_weights", encode_weights(run.policy()))

    def add(self, trajectory: Trajectory, policy: PublishedPolicy) -> None:
        """Write a trajectory that was learned from, and the weights it led to."""
        if self.failure is not None or self._writer is None:
            return
        self._write("/trajectories", encode_trajectory(trajectory))
        self._frames += len(trajectory)
        if self._frames >= WEIGHTS_EVERY_FRAMES:
            self._frames = 0
            self._write("/policy_weights", encode_weights(policy))
        if time.monotonic() - self._flushed >= FLUSH_S:
            self._flushed = time.monotonic()
            self._guarded(self._writer.flush)

    def _write(self, name: str, message: Message) -> None:
        """Write a message with a later stamp than the one before: bags are read in that order."""
        assert self._writer is not None
        write, payload = self._writer.write, to_cdr(self._types, message)
        self._stamp_ns = max(self._stamp_ns + 1, now_ns())
        self._guarded(lambda: write(name, payload, self._stamp_ns))

    def _guarded(self, act: Callable[[], None]) -> None:
        if self.failure is None:
            try:
                act()
            except BagFullError as error:
                self.failure = error
                log.warning("recording ended: %s", error)
