"""The display of `pa_ros train`: a table of evaluations, and a progress line below it."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import TextIO

from rich.console import Console
from rich.live import Live
from rich.text import Text

from pa_ros.core.text import renewable

LINE_PERIOD_S = 5.0  # of lines without a terminal
REFRESH_S = 0.2  # of the line in a terminal
RECENT = 20  # episodes
NONE = "–"


@dataclass(frozen=True)
class Telling:
    """A watcher that calls a function after each episode: with frames and reward per step."""

    tell: Callable[[int, float], object]

    def episode(self, frames: int, steps: int, reward: float) -> None:
        self.tell(frames, reward)

    def row(self, row: Mapping[str, float]) -> None:
        """Nothing: progress.csv has it."""


@dataclass(frozen=True)
class ScoreColumn:
    """One column: its title, where its number comes from, and how that is written."""

    title: str
    key: str
    form: str
    width: int


COLUMNS = (
    ScoreColumn("frames", "frames", "{:,.0f}", 9),
    ScoreColumn("time", "wall_s", "{:.0f} s", 7),
    ScoreColumn("updates", "updates", "{:,.0f}", 9),
    ScoreColumn("reward/step", "behaviour.reward_per_step", "{:+.3f}", 11),
    ScoreColumn("critic loss", "critic_loss", "{:.5f}", 11),
    ScoreColumn("mean Q", "mean_q", "{:+.3f}", 7),
    ScoreColumn("trained", "train_greedy.normalized", "{:.2f}", 7),
    ScoreColumn("held out", "eval_greedy.normalized", "{:.2f}", 8),
)
LEGEND = "trained, held out: scores of greedy episodes, 0 random, 1 scripted"


class TrainingView:
    """Shows each evaluation and the progress (`pa_ros.learning.interfaces.Watcher`).

    A context manager. In a terminal the progress line is redrawn in place; elsewhere one is printed
    every LINE_PERIOD_S. `unread`: the reader of the output, such as `| head`, has ended.
    """

    def __init__(self, frames: int, stream: TextIO | None = None) -> None:
        """`frames`: where the run ends."""
        self._frames, self._stream = frames, stream or sys.stdout
        self._console = Console(file=self._stream, highlight=False)
        self._live: Live | None = None
        self.unread = False
        self._titled = False
        self._shown = time.monotonic()
        self._recent: deque[float] = deque(maxlen=RECENT)
        self._times: deque[tuple[float, int]] = deque([(self._shown, 0)], maxlen=RECENT)

    def __enter__(self) -> TrainingView:
        if renewable(self._console):
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def episode(self, frames: int, steps: int, reward: float) -> None:
        """`frames` steps were taken; the last episode had `steps`, of this mean reward."""
        if not self._recent:  # a resumed run doesn't begin at 0
            self._times[0] = (self._times[0][0], frames - steps)
        now = time.monotonic()
        self._recent.append(reward)
        self._times.append((now, frames))
        if now - self._shown >= (LINE_PERIOD_S if self._live is None else REFRESH_S):
            self._shown = now
            self._say(self._line(frames))

    def row(self, row: Mapping[str, float]) -> None:
        """Print an evaluation, without columns that it lacks."""
        columns = [column for column in COLUMNS if column.key in row]
        if not self._titled:
            self._titled = True
            self._print(LEGEND)
            self._print("  ".join(f"{c.title:>{c.width}}" for c in columns))
        self._print("  ".join(f"{_written(c, row[c.key]):>{c.width}}" for c in columns))

    def _line(self, frames: int) -> str:
        (since, before), (until, _) = self._times[0], self._times[-1]
        rate = (frames - before) / max(until - since, 1e-9)
        left = max(self._frames - frames, 0) / max(rate, 1e-9)
        return (
            f"{frames:,} of {self._frames:,} frames  {rate:,.0f}/s  "
            f"reward/step {fmean(self._recent):+.3f}  {left:.0f} s left"
        )

    def _say(self, line: str) -> None:
        if self._live is None:
            self._print(line)
        else:
            text = Text(line, style="dim", no_wrap=True, overflow="ellipsis")
            self._live.update(text, refresh=True)

    def _print(self, line: str) -> None:
        if self._live is None:
            try:
                print(line, file=self._stream, flush=True)
            except BrokenPipeError:
                self.unread = True
            except OSError:  # a full disk: what is learned matters more than this line
                pass
        else:
            self._console.print(line, soft_wrap=True, markup=False)


def _written(column: ScoreColumn, value: float) -> str:
    return NONE if math.isnan(value) else column.form.format(value)
