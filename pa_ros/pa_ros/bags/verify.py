"""Repeats a recorded run and compares it: weights version by version, transitions one by one.

Learning is a function of configuration, seed and the order of trajectories (docs/DESIGN.md), and an
arena's answer is a function of its seed, episode and actions. With the same software versions both
are repeated to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from pa_ros.arena import design_named, preset_named
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.experience import Experience, UsedTrajectory
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Observation, Verdict
from pa_ros.core.software import here
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig
from pa_ros.perception import task_seen
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.diagnostics import Origin
from pa_ros.wire.learning import weights_checksum
from pa_ros.world import Trajectory, reward_from

NAMED = 5  # altered transitions that are described


@dataclass
class Verification:
    """The result of a verification; it grows while the run is repeated."""

    compared: int = 0  # versions of the weights with equal hashes
    version: int = 0  # of the newest weights computed here
    frames: int = 0
    updates: int = 0
    recorded: str = ""  # hash of the newest weights compared, as recorded
    computed: str = ""  # hash of the newest weights compared, as computed here
    difference: str = ""  # where the weights first differ; empty: nowhere
    incomplete: str = ""  # what was not compared, and why; empty: everything was compared
    altered: int = 0  # trajectories that differ from what the arena gives
    named: list[str] = field(default_factory=list)  # the first of them, by transition
    checked: int = 0  # transitions compared with a fresh arena
    skipped: int = 0  # transitions that could not be compared with an arena
    note: str = ""  # recorded and installed software versions

    @property
    def equal(self) -> bool:
        """Whether everything was compared, and everything is as recorded."""
        return self.compared > 0 and not (self.difference or self.incomplete or self.altered)


def learner_of(experience: Experience) -> Learner:
    """The learner of a recording as it was at the start of its run.

    Raises ProvenanceError if it did not begin from scratch, ConfigError for unknown settings.
    """
    origin = experience.learner
    about = origin.learner
    assert about is not None
    if about.first_version != 0:
        raise ProvenanceError(
            f"provenance of {origin.node}: expected a run from scratch, got one resumed at version "
            f"{about.first_version}: its replay buffer is not in the bag"
        )
    network = NetworkConfig.from_json(about.network)
    config = ALGORITHMS[about.algorithm].config.from_json(about.learner)
    return Learner(network, config, about.training_programs, origin.seed, experience.scoring)


def verify(
    experience: Experience,
    arena: bool = True,
    progress: Callable[[Verification], None] | None = None,
) -> Verification:
    """Learn again from the bag, and compare until the weights first differ.

    With `arena`, recorded transitions are also compared with a fresh arena, all of them even if the
    weights differ. Raises ProvenanceError if the run cannot be repeated.
    """
    found = Verification(note=_software(experience.learner))
    learner = learner_of(experience)
    if experience.unordered:
        found.incomplete = (
            f"the first {experience.unordered} versions of the weights were not recorded, so the "
            "order in which trajectories of several agents led to them is not known"
        )
        return found
    arenas: dict[str, ArenaReplay] = {}
    _compare(experience, learner, found)
    for one in experience.used(learner.network.world):
        missing = _missing(one, learner.counters.version, found)
        if one.trajectory is None or missing:
            found.incomplete = missing
            break
        if arena:
            _compare_with_arena(experience, one.trajectory, arenas, found)
        if one.version is not None and not found.difference:
            try:
                learner.consume(one.trajectory)
            # The learner must accept again everything that the recorded learner accepted.
            except PaError as error:
                found.difference = f"version {one.version}: {error}"
            _compare(experience, learner, found)
        # The weights differ already, so only transitions are left to compare.
        elif not arena:
            break
        if progress is not None:
            progress(found)
    if not found.incomplete:
        found.incomplete = _not_compared(experience, found)
    return found


def _missing(one: UsedTrajectory, version: int, found: Verification) -> str:
    """Why the learner cannot use the next trajectory; empty if it can."""
    if one.trajectory is None:
        return (
            f"trajectory {one.key.sequence} of {one.key.agent_id}, which led to version "
            f"{one.version}, is not in the bag"
        )
    if one.version is not None and one.version > version + 1 and not found.difference:
        return (
            f"what led to versions {version + 1} to {one.version - 1} is not in the bag: the "
            "recording began too late"
        )
    return ""


def _not_compared(experience: Experience, found: Verification) -> str:
    """What was left out of a verification that reached its end; empty: nothing."""
    if found.skipped:
        return (
            f"{found.skipped} transitions could not be compared with an arena, because the "
            "beginning of their episode is missing or altered; --no-arena compares weights only"
        )
    if not found.compared and not found.difference:
        return "the bag contains no weights to compare with"
    return ""


def _compare(experience: Experience, learner: Learner, found: Verification) -> None:
    """Compare the learner's version with the recorded one, if it was recorded."""
    before, counters = found.updates, learner.counters
    found.version, found.frames, found.updates = counters.version, counters.frames, counters.updates
    published = experience.published.get(counters.version)
    if published is None or found.difference:
        return
    found.recorded, found.computed = published.checksum, weights_checksum(learner.snapshot())
    if found.recorded == found.computed:
        found.compared += 1
    else:
        between = f"updates {before + 1} to {counters.updates}" if counters.updates else "no update"
        found.difference = f"version {counters.version} ({between})"


def _compare_with_arena(
    experience: Experience,
    trajectory: Trajectory,
    arenas: dict[str, ArenaReplay],
    found: Verification,
) -> None:
    """Compare a trajectory with a fresh arena like its agent's, kept in `arenas`."""
    description = experience.arena_of(trajectory.agent_id)
    if description is None:
        found.incomplete = found.incomplete or (
            f"expected the description of the one arena of {trajectory.agent_id!r}, got "
            f"{len({arena.arena_id for arena in experience.arenas})}; --no-arena compares weights "
            "only"
        )
        return
    if description.arena_id not in arenas:
        asked = _asked(experience.origins, description.arena_id)
        arenas[description.arena_id] = ArenaReplay(description, *asked)
    name = arenas[description.arena_id].check(trajectory)
    found.checked = sum(arena.checked for arena in arenas.values())
    found.skipped = sum(arena.skipped for arena in arenas.values())
    if name is not None:
        found.altered += 1
        found.named = [*found.named, name][:NAMED]


class ArenaReplay:
    """Repeats recorded actions in a fresh arena, and compares what it gives to the last bit."""

    def __init__(
        self, arena: ArenaDescription, condition: str = "train", blocks: int | None = None
    ) -> None:
        """`blocks`: the number that the arena was started with, 0: the design's own; None: the
        number in its description.

        Raises ConfigError for a design, arm or preset that is not known here.
        """
        preset = preset_named(arena.preset, arena.arm).changed(
            episode_steps=arena.episode_steps, thresholds=arena.thresholds
        )
        design = design_named(arena.design).with_relations(*arena.world.relations)
        described = arena.block_count - design.n_places
        count = described if blocks is None else blocks or design.n_blocks
        design = replace(design, n_blocks=count)
        self.checked = 0  # transitions
        self.skipped = 0  # transitions whose episode's beginning is missing or altered
        reward = reward_from(arena.reward)
        self._task = task_seen(preset, design, arena.seed, arena.perception, reward)
        self._condition, self._world = condition, self._task.world
        self._speeds = np.array([*arena.speed_limits, *[1.0] * arena.world.gripper])
        self._at: tuple[int, int] | None = None  # episode and step; None: not as recorded
        self._observed: tuple[Observation, Verdict]

    def check(self, trajectory: Trajectory) -> str | None:
        """Describe the first transition that differs; None if all are equal or skipped."""
        if trajectory.first_step == 0:
            observation, verdict = self._task.reset(trajectory.episode, self._condition)
        elif self._at == (trajectory.episode, trajectory.first_step):
            observation, verdict = self._observed
        else:
            self.skipped += len(trajectory)
            return None
        self._at = None
        if trajectory.program != self._task.program:
            observation, verdict = self._task.set_program(trajectory.program)
        cause = self._difference(trajectory, 0, observation, None)
        if cause is not None:
            return _named(trajectory, 0, cause)
        for t in range(len(trajectory)):
            command = self._world.joint_action(trajectory.actions[t], observation.joint_position)
            observation, verdict = self._task.step(command.astype(np.float64) * self._speeds)
            self.checked += 1
            cause = self._difference(trajectory, t + 1, observation, verdict)
            if cause is not None:
                return _named(trajectory, t, cause)
        self._observed = (observation, verdict)
        self._at = (trajectory.episode, observation.step)
        return None

    def _difference(
        self, trajectory: Trajectory, row: int, observation: Observation, verdict: Verdict | None
    ) -> str | None:
        """What differs in a row; None if nothing does."""
        # Objects that were found at the last row begin with the next trajectory.
        known = trajectory.objects.shape[1] if row == len(trajectory) else None
        if not np.array_equal(trajectory.objects[row], observation.objects[:known]):
            return "the objects are not what the arena gives"
        if not np.array_equal(trajectory.arm[row], self._task.world.arm(observation)):
            return "the arm is not what the arena gives"
        if verdict is not None and trajectory.rewards[row - 1] != np.float32(verdict.reward):
            return (
                f"reward {trajectory.rewards[row - 1]} recorded, the arena gives {verdict.reward}"
            )
        measures = trajectory.measures
        if verdict is not None and measures is not None:
            if tuple(measures[row].tolist()) != verdict.measures:
                return "the programs' measures are not what the arena gives"
        return None


def _named(trajectory: Trajectory, t: int, cause: str) -> str:
    return (
        f"transition {t} of trajectory {trajectory.sequence} of {trajectory.agent_id} "
        f"(episode {trajectory.episode}, step {trajectory.first_step + t}): "
        f"after the recorded action {cause}"
    )


def _asked(origins: Iterable[Origin], arena_id: str) -> tuple[str, int | None]:
    """The condition of the training episodes, and the number of blocks asked for."""
    for origin in origins:
        if origin.instance == arena_id and "condition" in origin.parameters:
            blocks = origin.parameters.get("blocks")
            return str(origin.parameters["condition"]), None if blocks is None else int(blocks)
    return "train", None


def _software(origin: Origin) -> str:
    if origin.versions == here():
        return f"the same software as recorded: {here()}"
    return f"recorded with {origin.versions}; here {here()}: the last bits may differ"
