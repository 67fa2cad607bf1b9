"""Moments of a recording: each control step with what the weights of that moment make of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pa_ros.bags.episodes import RecordedEpisode, Row, episodes
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.experience import PROVENANCE, WEIGHTS, arenas_of
from pa_ros.bags.reader import Bag
from pa_ros.console.insight import Insight, logic_of
from pa_ros.console.moment import Moment, looked
from pa_ros.core.errors import PaError
from pa_ros.core.experience import Observation
from pa_ros.learning.checkpoints import load_policy
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.diagnostics import decode_provenance
from pa_ros.wire.learning import decode_weights


class Replay:
    """Moments of a bag. Raises ProvenanceError if no arena described itself in it."""

    def __init__(self, bag: Bag, namespace: str | None = None) -> None:
        self._bag, self._namespace = bag, namespace
        arenas = arenas_of(bag, namespace)
        if not arenas:
            raise ProvenanceError(f"bag: {bag.path}: expected an arena's description, got none")
        self.arena = arenas[0]
        self._vocabulary = self.arena.world.vocabulary
        self.episodes = [episode for episode in episodes(bag, namespace) if episode.rows]
        if not self.episodes:
            raise ProvenanceError(f"bag: {bag.path}: expected control steps, got none")
        self._stamps = dict(self._versions())
        self._insight = lru_cache(maxsize=8)(self._load)

    def moment(self, episode: int, step: int) -> Moment:
        """A row of an episode, by their places in the recording."""
        recorded = self.episodes[episode]
        row = recorded.rows[step]
        seen = _observation(recorded, row)
        insight, why = self._insight(_acted(recorded, step))
        look, unsaid = looked(insight, seen, row.program, self._vocabulary)
        return Moment(
            self.arena, seen, recorded.evaluation, row.program, row.reward, row.distance,
            _satisfied(self.arena, row), look,
            why or unsaid,
        )  # fmt: skip

    def _versions(self) -> Iterator[tuple[int, int]]:
        """Recorded versions of the weights, and when each was recorded."""
        if WEIGHTS in self._bag.types.values():
            for recorded in self._bag.messages([self._bag.topic_of(WEIGHTS, self._namespace)]):
                snapshot = decode_weights(self._bag.deserialize(recorded)).snapshot
                yield snapshot.version, recorded.stamp_ns

    def _load(self, version: int) -> tuple[Insight | None, str]:
        """The weights of a version, or the newest recorded before it; or why there are none."""
        earlier = [known for known in self._stamps if known <= version]
        try:
            agent = self._agent()
            if earlier:
                return Insight(self._recorded(max(earlier)), logic_of(agent)), ""
            if agent.get("weights") != "checkpoint":
                return None, ""
            return Insight(load_policy(Path(str(agent["checkpoint"]))), logic_of(agent)), ""
        except PaError as error:
            return None, str(error)

    def _recorded(self, version: int) -> Any:
        stamp_ns = self._stamps[version]
        topic = self._bag.topic_of(WEIGHTS, self._namespace)
        for recorded in self._bag.messages([topic], stamp_ns, stamp_ns + 1):
            return decode_weights(self._bag.deserialize(recorded)).snapshot
        raise ProvenanceError(f"bag: {self._bag.path}: version {version} can't be read again")

    def _agent(self) -> Mapping[str, Any]:
        """What an agent node said of itself; nothing, where one trains in a learner's process."""
        if PROVENANCE not in self._bag.types.values():
            return {}
        for recorded in self._bag.messages([self._bag.topic_of(PROVENANCE, self._namespace)]):
            parameters = decode_provenance(self._bag.deserialize(recorded)).parameters
            if "checkpoint" in parameters:
                return parameters
        return {}


def _acted(episode: RecordedEpisode, step: int) -> int:
    """Version of the weights that acted at a row, or last before it."""
    known = [row.policy_version for row in episode.rows[step::-1] if row.policy_version >= 0]
    return known[0] if known else max(row.policy_version for row in episode.rows)


def _observation(episode: RecordedEpisode, row: Row) -> Observation:
    """The row as the agent saw it; velocities and a hand's pose that are not recorded are zero."""
    return Observation(
        episode.number,
        row.step,
        max(row.stamp_ns, 0),
        row.objects,
        row.joint_position,
        np.nan_to_num(row.joint_velocity),
        row.hand_index,
        "",
        np.nan_to_num(row.hand_pose),
    )


def _satisfied(arena: ArenaDescription, row: Row) -> bool | None:
    """As the arena's description says of the program's relation; None where nothing is recorded."""
    thresholds = dict(zip(arena.world.relations, arena.thresholds, strict=True))
    threshold = thresholds.get(row.program.partition("(")[0])
    return None if threshold is None or np.isnan(row.distance) else row.distance <= threshold
