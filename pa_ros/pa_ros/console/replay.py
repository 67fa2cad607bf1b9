"""A recorded run on the page: episode by episode, step by step, with the weights of each moment."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from pa_ros.bags.episodes import RecordedEpisode
from pa_ros.console import markup
from pa_ros.console.page import Page
from pa_ros.console.recorded import Replay


class Timeline:
    """Where the page stands in a recording, and the controls that move it."""

    def __init__(self, replay: Replay, page: Page) -> None:
        self._replay, self._page = replay, page
        self._lock = threading.Lock()
        self._place, self._shown, self._playing = (0, 0), (-1, -1), False
        self._sliders: list[tuple[Any, Any]] = []
        page.say("History", self._contents())

    def tick(self, pages: int) -> None:
        """Draw where the timeline stands; a step further if it plays."""
        with self._lock:
            episode, step = self._place
            if self._playing and pages:
                step = (step + 1) % len(self._replay.episodes[episode].rows)
                self._place = episode, step
        if not pages or (episode, step) == self._shown:
            return
        self._shown = episode, step
        self._page.show(self._replay.moment(episode, step))

    def controls(self, client: viser.ClientHandle) -> object:
        """A timeline of its own for a page; all move the same."""
        gui, recorded = client.gui, self._replay.episodes
        with gui.add_folder("Timeline", order=0):
            episode = gui.add_slider("Episode", 0, max(len(recorded) - 1, 1), 1, 0,
                                     disabled=len(recorded) == 1)  # fmt: skip
            step = gui.add_slider("Step", 0, max(len(recorded[0].rows) - 1, 1), 1, 0)
            play = gui.add_button_group("Play", ("Play", "Stop"))

        def chosen(_: Any) -> None:
            step.max = max(len(recorded[_place(episode.value, recorded)].rows) - 1, 1)
            step.value = 0
            self._go(episode.value, 0)

        episode.on_update(chosen)
        step.on_update(lambda _: self._go(episode.value, step.value))
        play.on_click(lambda _: self._play(play.value == "Play"))
        return episode

    def _go(self, episode: float, step: float) -> None:
        place = _place(episode, self._replay.episodes)
        with self._lock:
            self._place = place, _place(step, self._replay.episodes[place].rows)

    def _play(self, playing: bool) -> None:
        with self._lock:
            self._playing = playing

    def _contents(self) -> str:
        """Which episodes there are."""
        return markup.pairs(
            (
                (str(place), _summary(episode))
                for place, episode in enumerate(self._replay.episodes[:200])
            ),
            "History",
        )


def _place(wish: float, among: Sequence[object]) -> int:
    """The place nearest to a number, which a page may have sent without its slider."""
    return int(min(max(0, wish), len(among) - 1))  # 0 for NaN: `max` keeps its first


def _summary(episode: RecordedEpisode) -> str:
    rewards = episode.rewards
    mean = f", {np.mean(rewards):+.2f} a step" if len(rewards) else ""
    kind = "evaluation episode" if episode.evaluation else "episode"
    return f"{kind} {episode.number}{mean}: {episode.rows[-1].program}"
