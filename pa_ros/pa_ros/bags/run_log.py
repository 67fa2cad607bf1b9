"""Recording a run in one process: the messages that a graph would have published."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pa_ros.arena import ArenaConfig, Design
from pa_ros.bags.contents import reliable_qos, topic
from pa_ros.bags.errors import BagFullError
from pa_ros.bags.writer import BagOptions, BagWriter, refuse_existing
from pa_ros.core.published import PublishedPolicy
from pa_ros.language import Program
from pa_ros.learning.run import LearningRun
from pa_ros.provenance.metadata import as_custom_data
from pa_ros.provenance.origins import describe, learner_origin
from pa_ros.wire import Message
from pa_ros.wire.arena import encode_arena_info
from pa_ros.wire.definitions import installed_types, to_cdr
from pa_ros.wire.diagnostics import encode_provenance
from pa_ros.wire.learning import encode_learner_info, encode_trajectory, encode_weights
from pa_ros.world import Trajectory

log = logging.getLogger(__name__)

NODE: Final = "/pa_ros_train"
WEIGHTS_EVERY_FRAMES: Final = 100  # at most; a version per frame would be 26 MB/s
FLUSH_S: Final = 1.0  # what a SIGKILL can cost
_TOPICS = (
    ("/provenance", "Provenance", reliable_qos(1, latched=True)),
    ("/arena_info", "ArenaInfo", reliable_qos(1, latched=True)),
    ("/learner_info", "LearnerInfo", reliable_qos(1, latched=True)),
    ("/trajectories", "Trajectory", reliable_qos(1, keep_all=True)),
    ("/policy_weights", "PolicyWeights", reliable_qos(4, latched=True)),
)


class RunLog:
    """A `pa_ros.learning.loop.Log` that writes a bag; a context manager that closes it.

    The bag is there once the run begins: one that is refused leaves none. A full disk closes the
    bag readable and sets `failure`; the run goes on unrecorded.
    """

    def __init__(
        self,
        folder: Path,
        arena: ArenaConfig,
        design: Design,
        seed: int,
        training_programs: Sequence[Program],
        parameters: dict[str, Any],
        options: BagOptions | None = None,
    ) -> None:
        """`parameters`: options of the run, plain JSON. Raises BagError if `folder` exists."""
        self.failure: BagFullError | None = None
        self._arena, self._design, self._seed = arena, design, seed
        self._programs, self._parameters = training_programs, parameters
        self._types = installed_types()
        refuse_existing(folder)
        self._folder, self._options = folder, options
        self._writer: BagWriter | None = None
        self._stamp_ns = 0
        self._flushed = time.monotonic()
        self._frames = 0  # since the newest weights written

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is None:
            return
        try:
            self._writer.close()
        except BagFullError as error:
            self._fail(error)

    def begin(self, run: LearningRun) -> None:
        """What the run is, and the weights that it begins with. Raises BagError if there is a bag
        by now, BagFullError if it cannot be made."""
        self._writer = writer = BagWriter(self._folder, self._options)
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
        arena = describe(*about_arena, reward=learner.scoring.reward)
        writer.custom = as_custom_data([about], [arena])
        self._write("/provenance", encode_provenance(about))
        self._write("/arena_info", encode_arena_info(arena))
        self._write("/learner_info", encode_learner_info(run.info))
        self._write("/policy_weights", encode_weights(run.policy()))

    def add(self, trajectory: Trajectory, policy: PublishedPolicy) -> None:
        """A trajectory that was learned from, and the weights that came of it."""
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
        """Stamps grow, so that the order in the bag is the order of the run."""
        assert self._writer is not None
        write, payload = self._writer.write, to_cdr(self._types, message)
        self._stamp_ns = max(self._stamp_ns + 1, time.time_ns())
        self._guarded(lambda: write(name, payload, self._stamp_ns))

    def _guarded(self, act: Any) -> None:
        if self.failure is None:
            try:
                act()
            except BagFullError as error:
                self._fail(error)

    def _fail(self, error: BagFullError) -> None:
        self.failure = error
        log.warning("recording ended: %s", error)
