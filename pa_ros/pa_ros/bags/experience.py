"""What a learner learned, in its own order, from a recording of its run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from pa_ros.bags.errors import ForeignBagError, ProvenanceError
from pa_ros.bags.reader import Bag, Recorded
from pa_ros.core.experience import AgentKey, TrajectoryKey
from pa_ros.learning.algorithms import ALGORITHMS
from pa_ros.learning.turns import in_turn
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


@dataclass(frozen=True, slots=True)
class Published:
    """What a bag says of one version of the weights."""

    version: int
    checksum: str  # SHA-256 of the tensors' bytes
    run_id: str
    accounted: Mapping[AgentKey, int]  # every trajectory before this one is accounted for
    latest: TrajectoryKey | None  # led to this version; None: not known


@dataclass(frozen=True, slots=True)
class Lesson:
    """A trajectory in its turn. `version`: of the weights that it led to; None if not known."""

    key: TrajectoryKey
    trajectory: Trajectory | None  # None: the bag lacks it, though the learner had it
    version: int | None


_BEGINNING: Final = Published(0, "", "", {}, None)  # before anything was learned


class Experience:
    """The learning recorded in one bag. Raises ForeignBagError if there are no transitions."""

    def __init__(self, bag: Bag, namespace: str | None = None) -> None:
        self._bag, self._namespace = bag, namespace
        self.unseen = bag.unseen
        self._topic = bag.topic_of(TRAJECTORIES, namespace)
        self.origins: list[Origin] = [
            bag.through(recorded, decode_provenance)
            for recorded in _of_type(bag, PROVENANCE, namespace)
        ]
        self.arenas = arenas_of(bag, namespace)
        self._agents = self._turns()
        self.published = self._published()
        self.keys = self._arrivals()  # trajectories in the order of the recording, each once

    @property
    def learner(self) -> Origin:
        """Of the one learner, as it began. ProvenanceError if there is none, or several."""
        found = [origin for origin in self.origins if origin.learner is not None]
        runs = {origin.instance for origin in found}
        if len(runs) != 1:
            raise ProvenanceError(
                f"bag: {self._bag.path}: expected the provenance of one learner, got "
                f"{len(runs)}: nothing says how this run was made"
            )
        return found[0]

    def arena_of(self, agent_id: str) -> ArenaDescription | None:
        """An agent's arena: the only one, or the one of its namespace; None if that is none, or
        several."""
        places = {_namespace(one) for one in self.origins if one.instance == agent_id}
        beside = {one.instance for one in self.origins if _namespace(one) in places}
        found = {arena.arena_id: arena for arena in self.arenas}
        if len(found) > 1:
            found = {name: arena for name, arena in found.items() if name in beside}
        return next(iter(found.values())) if len(found) == 1 else None

    @property
    def scoring(self) -> Scoring:
        """The arenas' rule, by which the learner relabeled. ProvenanceError if nothing tells it."""
        rules = {(arena.world.relations, arena.thresholds) for arena in self.arenas}
        if len(rules) != 1:
            raise ProvenanceError(
                f"bag: {self._bag.path}: expected the same thresholds in the arenas' descriptions, "
                f"got {sorted(rules)}: nothing says what was rewarded"
            )
        rewards = {arena.reward for arena in self.arenas}
        if len(rewards) != 1:
            raise ProvenanceError(
                f"bag: {self._bag.path}: expected one reward in the arenas' descriptions, "
                f"got {sorted(rewards)}: nothing says what was paid"
            )
        return Scoring.of(*rules.pop(), reward_from(rewards.pop()))

    @property
    def unheard(self) -> int:
        """Versions of the weights before the first that was recorded. The trajectories that led to
        them come in the order of the recording, which is the learner's if there was one agent."""
        about = [origin.learner for origin in self.origins if origin.learner is not None]
        if not self.published or len({one.first_version for one in about}) != 1:
            return 0
        return max(0, min(self.published) - about[0].first_version)

    def lessons(self, world: World) -> Iterator[Lesson]:
        """Trajectories in the learner's order, as far as the weights tell it; else as they came.

        `world` is the receiver's. Raises WireError at the first of another one.
        """
        plan, pending = self._plan(), dict[TrajectoryKey, Trajectory]()
        there = set(self.keys)
        messages = self._trajectories(world)
        for key, version in plan:
            while key in there and key not in pending:
                trajectory = next(messages, None)
                if trajectory is None:
                    break
                pending.setdefault(trajectory.key, trajectory)
            yield Lesson(key, pending.pop(key, None), version)

    def _plan(self) -> list[tuple[TrajectoryKey, int | None]]:
        """Which trajectory comes when, as the versions tell."""
        left = dict.fromkeys(self.keys)
        plan: list[tuple[TrajectoryKey, int | None]] = []
        versions = sorted(self.published)
        if self.unheard:
            versions.insert(0, versions[0] - self.unheard)
        for before, version in zip(versions, versions[1:], strict=False):
            between = self._between(left, before, version)
            for led_to, key in enumerate(between, start=version - len(between) + 1):
                left.pop(key, None)
                plan.append((key, led_to))
        return plan + [(key, None) for key in left]

    def _between(
        self, left: Mapping[TrajectoryKey, None], before: int, version: int
    ) -> list[TrajectoryKey]:
        """What led from one recorded version to the next, in order. The last is known; of those
        that led to versions not recorded, the accounts tell."""
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
        if self._agents:
            within = in_turn(within, self._agents, before)
        return within[: version - before - len(last)] + last

    def _turns(self) -> tuple[str, ...]:
        """Agents in the order of their turns; empty: there were none."""
        for origin in self.origins:
            if origin.learner is not None and "agents" in origin.parameters:
                config = ALGORITHMS[origin.learner.algorithm].config
                settings = config.from_json(origin.learner.learner)
                exact = settings.schedule.in_step == "exact"
                return tuple(map(str, origin.parameters["agents"])) if exact else ()
        return ()

    def _published(self) -> dict[int, Published]:
        """By version, of the run that the provenance tells of."""
        runs = {origin.instance for origin in self.origins if origin.learner is not None}
        found: dict[int, Published] = {}
        for recorded in _of_type(self._bag, WEIGHTS, self._namespace):
            one = self._bag.through(recorded, _published)
            if not runs or one.run_id in runs:
                if one.version not in found or one.latest is not None:
                    found[one.version] = one
        return found

    def _arrivals(self) -> list[TrajectoryKey]:
        """Trajectories in the order of the recording, each once."""
        keys = dict.fromkeys(
            self._bag.through(recorded, decode_trajectory_key)
            for recorded in self._bag.messages([self._topic])
        )
        if not keys:
            raise ForeignBagError(f"bag: {self._bag.path}: expected transitions, got none")
        return list(keys)

    def _trajectories(self, world: World) -> Iterator[Trajectory]:
        decode = partial(decode_trajectory, world=world)
        for recorded in self._bag.messages([self._topic]):
            yield self._bag.through(recorded, decode)


def arenas_of(bag: Bag, namespace: str | None = None) -> list[ArenaDescription]:
    """What arenas said of themselves, in the order of the recording."""
    return [
        bag.through(recorded, decode_arena_info)
        for recorded in _of_type(bag, ARENA_INFO, namespace)
    ]


def recorded_world(bag: Bag, namespace: str | None = None) -> World:
    """The world of a recording. ProvenanceError if no learner and no arena tells them."""
    for arena in arenas_of(bag, namespace):
        return arena.world
    for recorded in _of_type(bag, PROVENANCE, namespace):
        origin = bag.through(recorded, decode_provenance)
        if origin.world is not None:
            return origin.world
    raise ProvenanceError(
        f"bag: {bag.path}: expected an arena's description or a learner's provenance, got none: "
        "nothing says what objects and programs are made of"
    )


def _namespace(origin: Origin) -> str:
    return origin.node.rpartition("/")[0]


def _of_type(bag: Bag, type_name: str, namespace: str | None) -> Iterator[Recorded]:
    if type_name not in bag.types.values():
        return
    of_several = type_name in (PROVENANCE, ARENA_INFO)  # each arena of a fleet has its own
    topics = bag.topics_of(type_name, namespace) if of_several else []
    yield from bag.messages(topics or [bag.topic_of(type_name, namespace)])


def _published(message: Message) -> Published:
    policy = decode_weights(message)
    checksum = weights_checksum(policy.snapshot)
    return Published(
        policy.snapshot.version, checksum, policy.run_id, policy.accounted, policy.latest
    )
