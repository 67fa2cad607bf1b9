"""Learning from recordings: trajectories in the order in which their learner used them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final, Self, TypeVar

from pa_ros.bags.errors import BagError, ProvenanceError
from pa_ros.bags.reader import Bag
from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.fixed_order import in_fixed_order
from pa_ros.learning.learner import Learner
from pa_ros.wire import Message
from pa_ros.wire.arena import ArenaDescription, decode_arena_info
from pa_ros.wire.diagnostics import Origin, decode_provenance
from pa_ros.wire.learning import (
    decode_trajectory,
    decode_trajectory_key,
    decode_weights,
    weights_checksum,
)
from pa_ros.world import Scoring, Trajectory, reward_from
from pa_ros.world.world import World

TRAJECTORIES: Final = "msgs_schema/msg/Trajectory"
WEIGHTS: Final = "msgs_schema/msg/PolicyWeights"
PROVENANCE: Final = "msgs_schema/msg/Provenance"
ARENA_INFO: Final = "msgs_schema/msg/ArenaInfo"

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RecordedWeights:
    """One version of the weights, as recorded in a bag."""

    version: int
    checksum: str  # SHA-256 of the tensors' bytes
    run_id: str
    accounted: Mapping[AgentKey, int]  # of each agent, all trajectories before this one were used
    latest: TrajectoryKey | None  # led to this version; None: not known


@dataclass(frozen=True, slots=True)
class UsedTrajectory:
    """A trajectory in its learner's order."""

    key: TrajectoryKey
    trajectory: Trajectory | None  # None: the learner used it, but the bag lacks it
    version: int | None  # of the weights that it led to; None: not known


_BEGINNING: Final = RecordedWeights(0, "", "", {}, None)  # before anything was learned


@dataclass(frozen=True, eq=False)
class Experience:
    """The learning recorded in one bag; `read` makes one of a bag."""

    bag: Bag
    topic: str  # of the transitions
    origins: list[Origin]
    arenas: list[ArenaDescription]
    published: dict[int, RecordedWeights]  # by version
    keys: list[TrajectoryKey]  # in recorded order, each once: an agent may send one again

    @classmethod
    def read(cls, bag: Bag, namespace: str | None = None) -> Self:
        """Read all of a bag but the transitions themselves.

        Raises BagError (code bag.foreign) if it contains no transitions.
        """
        topic = bag.topic_of(TRAJECTORIES, namespace)
        origins = _decoded(bag, PROVENANCE, namespace, decode_provenance)
        arenas, published = arenas_of(bag, namespace), _published(bag, namespace, origins)
        keys = list(dict.fromkeys(bag.decoded([topic], decode_trajectory_key)))
        if not keys:
            raise BagError(f"bag: {bag.path}: expected transitions, got none", code="bag.foreign")
        return cls(bag, topic, origins, arenas, published, keys)

    @property
    def learner(self) -> Origin:
        """The one learner, as it began. Raises ProvenanceError if there are none or several."""
        found = [origin for origin in self.origins if origin.learner is not None]
        runs = {origin.instance for origin in found}
        if len(runs) != 1:
            raise ProvenanceError(
                f"bag: {self.bag.path}: expected the provenance of one learner, got {len(runs)}: "
                "it is not known how this run was made"
            )
        return found[0]

    def arena_of(self, agent_id: str) -> ArenaDescription | None:
        """An agent's arena: the only one, or that of its namespace; None if not known."""
        places = {_namespace(one) for one in self.origins if one.instance == agent_id}
        beside = {one.instance for one in self.origins if _namespace(one) in places}
        found = {arena.arena_id: arena for arena in self.arenas}
        if len(found) > 1:
            found = {name: arena for name, arena in found.items() if name in beside}
        return next(iter(found.values())) if len(found) == 1 else None

    @property
    def scoring(self) -> Scoring:
        """The arenas' scoring rule, which the learner relabeled with. Raises ProvenanceError."""
        rules = {(one.world.relations, one.thresholds, one.reward) for one in self.arenas}
        if len(rules) != 1:
            raise ProvenanceError(
                f"bag: {self.bag.path}: expected arenas with one set of thresholds and one "
                f"reward, got {sorted(rules)}: it is not known what was rewarded"
            )
        relations, thresholds, reward = rules.pop()
        return Scoring.of(relations, thresholds, reward_from(reward))

    @property
    def unordered(self) -> int:
        """Number of versions whose trajectories' order is not known.

        The weights recorded for a version name the trajectory that led to it. Of versions before
        the first recorded one, the order is known if one agent sent all trajectories, or if the
        learner took its agents in a fixed order.
        """
        first = {one.learner.first_version for one in self.origins if one.learner is not None}
        agents = {key[:2] for key in self.keys}
        if self._agents_in_order or len(agents) == 1 or len(first) != 1 or not self.published:
            return 0
        return max(0, min(self.published) - first.pop())

    def used(self, world: World) -> Iterator[UsedTrajectory]:
        """Yield trajectories in the learner's order as far as the weights tell it, then the others.

        Raises WireError at the first trajectory of another world than `world`.
        """
        there, read = set(self.keys), dict[TrajectoryKey, Trajectory]()
        decode = partial(decode_trajectory, world=world)
        trajectories = self.bag.decoded([self.topic], decode)
        for key, version in self._order():
            # The recording has trajectories as they arrived; those that come before their turn wait
            # here.
            while key in there and key not in read:
                trajectory = next(trajectories, None)
                if trajectory is None:
                    break  # the weights name it twice, and it was used already
                read.setdefault(trajectory.key, trajectory)
            yield UsedTrajectory(key, read.pop(key, None), version)

    def _order(self) -> list[tuple[TrajectoryKey, int | None]]:
        """The trajectories in the learner's order, with the version that each led to."""
        left = dict.fromkeys(self.keys)
        order: list[tuple[TrajectoryKey, int | None]] = []
        first = [one.learner.first_version for one in self.origins if one.learner is not None]
        versions = sorted({*self.published, *first[:1]} if self.published else ())
        for before, version in zip(versions, versions[1:], strict=False):
            between = self._between(left, before, version)
            for led_to, key in enumerate(between, start=version - len(between) + 1):
                left.pop(key, None)
                order.append((key, led_to))
        return order + [(key, None) for key in left]

    def _between(
        self, left: Mapping[TrajectoryKey, None], before: int, version: int
    ) -> list[TrajectoryKey]:
        """What led from one recorded version to the next, in order.

        The last trajectory is named in the weights. Those before it, which led to versions that
        were not recorded, follow from the counts of used trajectories.
        """
        earlier, later = self.published.get(before, _BEGINNING), self.published[version]
        last = [] if later.latest is None else [later.latest]
        within = [
            key
            for key in left
            if earlier.accounted.get(AgentKey(*key[:2]), 0)
            <= key.sequence
            < later.accounted.get(AgentKey(*key[:2]), 0)
            and key not in last
        ]
        if self._agents_in_order:
            within = in_fixed_order(within, self._agents_in_order, before)
        return within[: version - before - len(last)] + last

    @cached_property
    def _agents_in_order(self) -> tuple[str, ...]:
        """The agents in the order in which the learner took them; empty: as they arrived."""
        for origin in self.origins:
            if origin.learner is not None and "agents" in origin.parameters:
                config = ALGORITHMS[origin.learner.algorithm].config
                settings = config.from_json(origin.learner.learner)
                exact = settings.schedule.in_step == "exact"
                return tuple(map(str, origin.parameters["agents"])) if exact else ()
        return ()


@dataclass
class OfflineResult:
    """Counts of trajectories read from bags, by outcome."""

    accepted: int = 0
    missing: int = 0  # used by the recorded learner, but not in the bag
    left_out: int = 0  # in the bag, but not used by the recorded learner
    unordered: int = 0  # versions whose trajectories' order is not known

    @property
    def complete(self) -> bool:
        """Whether everything was learned that the recorded learners had learned."""
        return not (self.missing or self.unordered)


def learn(
    experiences: Sequence[Experience],
    learner: Learner,
    progress: Callable[[OfflineResult], None] | None = None,
) -> OfflineResult:
    """Give a learner the trajectories of one bag after the other, each in its run's own order.

    If a bag tells which trajectories its learner used, the others are left out. Agents of different
    runs are kept apart even if they have the same name, and so are an agent's incarnations.
    """
    found = OfflineResult()
    runs: dict[str, int] = {}
    for experience in experiences:
        learners = {one.instance for one in experience.origins if one.learner is not None}
        run = runs.setdefault("+".join(sorted(learners)) or str(id(experience)), len(runs))
        order_is_known = len(experience.published) > 1
        found.unordered += experience.unordered
        for one in experience.used(learner.network.world):
            if one.trajectory is None:
                found.missing += 1
            elif order_is_known and one.version is None:
                found.left_out += 1
            else:
                # Each incarnation and run gets a name of its own, or its numbers would pass for
                # duplicates.
                agent = f"{one.key.agent_id}@{(one.key.incarnation, run)}"
                trajectory = replace(one.trajectory, agent_id=agent, held_from=0)
                found.accepted += learner.consume(trajectory)
            if progress is not None:
                progress(found)
    return found


def arenas_of(bag: Bag, namespace: str | None = None) -> list[ArenaDescription]:
    """The arenas' descriptions in recorded order."""
    return _decoded(bag, ARENA_INFO, namespace, decode_arena_info)


def newest_arena(bag: Bag, namespace: str | None = None) -> ArenaDescription:
    """The arena's newest description. Raises ProvenanceError without any."""
    if arenas := arenas_of(bag, namespace):
        return arenas[-1]
    raise ProvenanceError(f"bag: {bag.path}: expected an arena's description, got none")


def recorded_world(bag: Bag, namespace: str | None = None) -> World:
    """The world of a recording. Raises ProvenanceError if it does not describe one."""
    for arena in arenas_of(bag, namespace):
        return arena.world
    for origin in _decoded(bag, PROVENANCE, namespace, decode_provenance):
        if origin.world is not None:
            return origin.world
    raise ProvenanceError(
        f"bag: {bag.path}: expected an arena's description or a learner's provenance, got neither: "
        "the meaning of the features is not known"
    )


def _published(
    bag: Bag, namespace: str | None, origins: Iterable[Origin]
) -> dict[int, RecordedWeights]:
    """The recorded weights by version, of the run that the provenance describes."""
    runs = {origin.instance for origin in origins if origin.learner is not None}
    found: dict[int, RecordedWeights] = {}
    for one in _decoded(bag, WEIGHTS, namespace, _recorded_weights):
        if not runs or one.run_id in runs:
            if one.version not in found or one.latest is not None:
                found[one.version] = one
    return found


def _namespace(origin: Origin) -> str:
    return origin.node.rpartition("/")[0]


def _decoded(
    bag: Bag, type_name: str, namespace: str | None, decode: Callable[[Message], T]
) -> list[T]:
    """The decoded messages of a type; none if the bag has no such topic."""
    if type_name not in bag.types.values():
        return []
    # In a fleet each arena has its own topics of these types.
    of_several = type_name in (PROVENANCE, ARENA_INFO)
    topics = bag.topics_of(type_name, namespace) if of_several else []
    return list(bag.decoded(topics or [bag.topic_of(type_name, namespace)], decode))


def _recorded_weights(message: Message) -> RecordedWeights:
    policy = decode_weights(message)
    return RecordedWeights(
        policy.snapshot.version,
        weights_checksum(policy.snapshot),
        policy.run_id,
        policy.accounted,
        policy.latest,
    )
