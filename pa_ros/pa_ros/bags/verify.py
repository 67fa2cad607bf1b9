"""Making a recorded run again, and comparing: weights version by version, transitions one by one.

Learning is a function of configuration, seed and the order of trajectories (docs/DESIGN.md), and so
is an arena's answer of its seed, episode and actions; with the same versions of the software
beneath, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.experience import Experience
from pa_ros.bags.reenact import Reenactment
from pa_ros.core.errors import PaError
from pa_ros.core.software import here
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.learner import Learner
from pa_ros.networks.config import NetworkConfig
from pa_ros.wire.diagnostics import Origin
from pa_ros.wire.learning import weights_checksum
from pa_ros.world import Trajectory

NAMED = 5  # altered transitions that are spelt out


@dataclass
class Verification:
    """What came of it; grows while it runs."""

    compared: int = 0  # versions of the weights with equal hashes
    version: int = 0  # of the newest weights made here
    frames: int = 0
    updates: int = 0
    recorded: str = ""  # hash of the newest weights compared, as recorded
    remade: str = ""  # hash of the newest weights compared, as made here
    difference: str = ""  # where the weights first differ; empty: nowhere
    incomplete: str = ""  # why nothing can be said from some point on; empty: all was verified
    altered: int = 0  # trajectories that the arena denies
    named: list[str] = field(default_factory=list)  # the first of them, by transition
    reenacted: int = 0  # transitions that the arena was asked about
    skipped: int = 0  # transitions that it could not be asked about
    note: str = ""  # what else to know

    @property
    def equal(self) -> bool:
        """Whether everything is as recorded, and there was something to compare."""
        flaws = self.difference or self.incomplete or self.altered
        return self.compared > 0 and not flaws


def learner_of(experience: Experience) -> Learner:
    """The learner that a recording tells of, as it was at the start of its run.

    Raises ProvenanceError if it did not begin from scratch, ConfigError if it is not understood.
    """
    origin = experience.learner
    about = origin.learner
    if about is None:
        raise ProvenanceError(f"provenance of {origin.node}: expected a learner's, got another's")
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
    """Learn again from the bag, comparing; stops where the weights first differ.

    With `arena`, recorded transitions are also held against a fresh arena. Raises ProvenanceError.
    """
    found = Verification(note=_software(experience.learner))
    learner = learner_of(experience)
    arenas = _FreshArenas(experience, found) if arena else None
    _compare(experience, learner, found)
    for lesson in experience.lessons(learner.network.world):
        if lesson.trajectory is None:
            found.incomplete = (
                f"trajectory {lesson.key.sequence} of {lesson.key.agent_id}, which led to "
                f"version {lesson.version}, is not in the bag"
            )
            break
        if arenas is not None:
            arenas.hold_against(lesson.trajectory)
        if not found.difference and lesson.version is not None:
            if lesson.version > learner.counters.version + 1:
                found.incomplete = (
                    f"what led to versions {learner.counters.version + 1} to {lesson.version - 1} "
                    "is not in the bag: its recording began too late"
                )
                break
            try:
                learner.consume(lesson.trajectory)
            except PaError as error:
                found.difference = f"version {lesson.version}: {error}"
            _compare(experience, learner, found)
        elif arenas is None:
            break
        if progress is not None:
            progress(found)
    if found.difference and experience.unheard and not found.compared:
        found.incomplete, found.difference = (
            (
                f"the first {experience.unheard} versions of the weights were not heard, nor is it "
                f"known in which order their trajectories were learned from: {found.difference} is "
                "not as recorded"
            ),
            "",
        )
    if experience.unseen and not found.incomplete:
        found.incomplete = f"parts of the bag were damaged and not seen: {experience.unseen}"
    if found.skipped and not found.incomplete:
        found.incomplete = (
            f"{found.skipped} transitions of episodes whose beginning is not recorded were not "
            "held against the arena; --no-arena compares weights only"
        )
    if not found.compared and not found.difference:
        found.incomplete = found.incomplete or "no weights are in the bag: nothing to compare with"
    return found


def _compare(experience: Experience, learner: Learner, found: Verification) -> None:
    """Hold this version against the recorded one, if it was recorded."""
    before, counters = found.updates, learner.counters
    found.version, found.frames, found.updates = counters.version, counters.frames, counters.updates
    published = experience.published.get(counters.version)
    if published is None or found.difference:
        return
    found.recorded, found.remade = published.checksum, weights_checksum(learner.snapshot())
    if found.recorded == found.remade:
        found.compared += 1
    else:
        between = f"updates {before + 1} to {counters.updates}" if counters.updates else "no update"
        found.difference = f"version {counters.version} ({between})"


class _FreshArenas:
    """Arenas like the recorded ones; each agent's transitions are held against its own."""

    def __init__(self, experience: Experience, found: Verification) -> None:
        self._experience, self._found = experience, found
        self._made: dict[str, Reenactment] = {}

    def hold_against(self, trajectory: Trajectory) -> None:
        """Note what the agent's arena denies, or that it is not known which it was."""
        found, description = self._found, self._experience.arena_of(trajectory.agent_id)
        if description is None:
            count = len({arena.arena_id for arena in self._experience.arenas})
            found.incomplete = found.incomplete or (
                "expected one arena's description to hold transitions of "
                f"{trajectory.agent_id!r} against, got {count}; --no-arena compares weights only"
            )
            return
        if description.arena_id not in self._made:
            asked = _asked(self._experience.origins, description.arena_id)
            self._made[description.arena_id] = Reenactment(description, *asked)
        name = self._made[description.arena_id].check(trajectory)
        found.reenacted = sum(arena.checked for arena in self._made.values())
        found.skipped = sum(arena.skipped for arena in self._made.values())
        if name is not None:
            found.altered += 1
            if len(found.named) < NAMED:
                found.named.append(name)


def _asked(origins: Iterable[Origin], arena_id: str) -> tuple[str, int | None]:
    """The condition that training episodes were drawn from, and the number of blocks asked for."""
    for origin in origins:
        if origin.instance == arena_id and "condition" in origin.parameters:
            blocks = origin.parameters.get("blocks")
            return str(origin.parameters["condition"]), None if blocks is None else int(blocks)
    return "train", None


def _software(origin: Origin) -> str:
    if origin.versions == here():
        return f"the same software as recorded: {here()}"
    return f"recorded with {origin.versions}; here {here()}: the last bits may differ"
