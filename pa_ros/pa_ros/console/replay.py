"""A recorded run on the page: step by step, explained by the weights of each moment."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import viser

from pa_ros.acting.insight import Insight, agent_logic, explained
from pa_ros.bags.episodes import RecordedEpisode, episodes
from pa_ros.bags.errors import ProvenanceError
from pa_ros.bags.experience import PROVENANCE, WEIGHTS, newest_arena
from pa_ros.bags.reader import Bag
from pa_ros.console import markup
from pa_ros.console.moment import Moment
from pa_ros.console.page import Page
from pa_ros.core.errors import PaError
from pa_ros.learning.checkpoints import load_policy
from pa_ros.wire.arena import ArenaDescription
from pa_ros.wire.diagnostics import decode_provenance
from pa_ros.wire.learning import decode_weights

LISTED = 200  # episodes in the table of contents


class Replay:
    """The moments of a bag; `read` makes it."""

    def __init__(
        self,
        bag: Bag,
        namespace: str | None,
        arena: ArenaDescription,
        episodes: Sequence[RecordedEpisode],
        stamps: Mapping[int, int],
    ) -> None:
        """`stamps`: when each version of the weights was recorded, in ns."""
        self._bag, self._namespace = bag, namespace
        self.arena, self.episodes, self._stamps = arena, episodes, stamps
        # Dragging the slider stays within a few versions, and loading one takes long.
        self._insight = lru_cache(maxsize=8)(self._load)

    @classmethod
    def read(cls, bag: Bag, namespace: str | None = None) -> Replay:
        """Decode a whole bag.

        Raises ProvenanceError if it has no arena's description, or no control steps.
        """
        arena = newest_arena(bag, namespace)
        whole = [episode for episode in episodes(bag, namespace) if episode.rows]
        if not whole:
            raise ProvenanceError(f"bag: {bag.path}: expected control steps, got none")
        stamps = {
            decode_weights(bag.deserialize(recorded)).snapshot.version: recorded.stamp_ns
            for recorded in bag.messages(_weights_of(bag, namespace))
        }
        return cls(bag, namespace, arena, whole, stamps)

    def moment(self, episode: int, step: int) -> Moment:
        """A row of an episode, both by their places in the recording."""
        recorded = self.episodes[episode]
        row = recorded.rows[step]
        insight, missing = self._insight(_acting_version(recorded, step))
        asked = row.step.program, self.arena.world.vocabulary, row.step.stage
        explanation, why = explained(insight, row.seen, *asked)
        return Moment(self.arena, row.step, row.reward, explanation, missing or why)

    def _load(self, version: int) -> tuple[Insight | None, str]:
        """The newest recorded weights up to a version, or why there are none."""
        earlier = [known for known in self._stamps if known <= version]
        try:
            agent = self._agent()
            if earlier:
                return Insight(self._recorded(max(earlier)), agent_logic(agent)), ""
            if agent.get("weights") != "checkpoint":
                return None, ""
            return Insight(load_policy(Path(str(agent["checkpoint"]))), agent_logic(agent)), ""
        except PaError as error:
            return None, str(error)

    def _recorded(self, version: int) -> Any:
        stamp_ns = self._stamps[version]
        (recorded,) = self._bag.messages(
            _weights_of(self._bag, self._namespace), stamp_ns, stamp_ns + 1
        )
        return decode_weights(self._bag.deserialize(recorded)).snapshot

    def _agent(self) -> Mapping[str, Any]:
        """The agent's parameters; empty if it ran in the learner's process."""
        topics = self._bag.topics_of(PROVENANCE, self._namespace)
        for origin in self._bag.decoded(topics, decode_provenance):
            if "checkpoint" in origin.parameters:
                return origin.parameters
        return {}


def _weights_of(bag: Bag, namespace: str | None) -> Sequence[str]:
    """Topics of weights; a fleet's learner is not in the namespace of an arena."""
    return bag.topics_of(WEIGHTS, namespace) or bag.topics_of(WEIGHTS)


def _acting_version(episode: RecordedEpisode, step: int) -> int:
    """The version of the weights that acted at a row, or last before it."""
    known = [row.policy_version for row in episode.rows[step::-1] if row.policy_version >= 0]
    return known[0] if known else max(row.policy_version for row in episode.rows)


class Timeline:
    """The moment of a recording that the page shows, and the controls that change it."""

    def __init__(self, replay: Replay, page: Page) -> None:
        self._replay, self._page = replay, page
        self._lock = threading.Lock()  # viser calls controls on its own threads
        self._place, self._shown, self._playing = (0, 0), (-1, -1), False
        contents = (_summary(episode) for episode in replay.episodes[:LISTED])
        page.set_panel("History", markup.pairs(
            ((str(place), summary) for place, summary in enumerate(contents)), "History"
        ))  # fmt: skip

    def tick(self, pages: int) -> None:
        """Draw the current moment, one step later if it plays and a page is open."""
        with self._lock:
            episode, step = self._place
            if self._playing and pages:
                step = (step + 1) % len(self._replay.episodes[episode].rows)
                self._place = episode, step
        if pages and (episode, step) != self._shown:
            self._shown = episode, step
            self._page.show(self._replay.moment(episode, step))

    def add_controls(self, client: viser.ClientHandle) -> None:
        """Add a timeline to a page; the timelines of all pages move the same recording."""
        gui, recorded = client.gui, self._replay.episodes
        with gui.add_folder("Timeline", order=0):
            episode = gui.add_slider("Episode", 0, max(len(recorded) - 1, 1), 1, 0,
                                     disabled=len(recorded) == 1)  # fmt: skip
            step = gui.add_slider("Step", 0, max(len(recorded[0].rows) - 1, 1), 1, 0)
            play = gui.add_button_group("Play", ("Play", "Stop"))

        def chosen(_: Any) -> None:
            step.max = max(len(recorded[_index(episode.value, recorded)].rows) - 1, 1)
            step.value = 0
            self._go(episode.value, 0)

        def pressed(_: Any) -> None:
            with self._lock:
                self._playing = play.value == "Play"

        episode.on_update(chosen)
        step.on_update(lambda _: self._go(episode.value, step.value))
        play.on_click(pressed)

    def _go(self, episode: float, step: float) -> None:
        place = _index(episode, self._replay.episodes)
        with self._lock:
            self._place = place, _index(step, self._replay.episodes[place].rows)


def _index(value: float, among: Sequence[object]) -> int:
    """The index nearest to a slider's value, which may be left over from a longer list."""
    return int(min(max(0, value), len(among) - 1))


def _summary(episode: RecordedEpisode) -> str:
    rewards = episode.rewards
    mean = f", reward per step {np.mean(rewards):+.2f}" if len(rewards) else ""
    kind = "evaluation episode" if episode.evaluation else "episode"
    return f"{kind} {episode.number}{mean}: {episode.rows[-1].step.program}"
